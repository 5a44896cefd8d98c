"""What the suites consist of, as data: attacks, parameters, and their names in the tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from meshmark.errors import UsageError
from meshmark.extension.parameters import name_and_parameters
from meshmark.extension.recipe import convert
from meshmark.extension.registry import catalogue

Per = Literal["frame", "animation"]
Scope = Literal["all", "first"]

NO_ATTACK = "none"


@dataclass(frozen=True)
class Cell:
    """One attack of a suite.

    Parameters
    ----------
    attack : str
        Name of the attack plugin; "none" leaves the copy alone.
    parameters : mapping of str to object
        What the attack is made with, `per` included where it takes it.
    per : {"frame", "animation"}
        Whether every frame is treated by itself, or the animation as a whole.
    label : str
        Name of the row; one of `paper.TABLE_2` where the paper has that row.
    family : str
        Cells of one family share a plot.
    frames : {"all", "first"}
        "first" is the static protocol: the first frame alone is attacked and verified.
    copy_as : str, optional
        Parameter of the attack that takes a second, differently marked copy of the mesh.
    """

    attack: str
    parameters: Mapping[str, Any]
    per: Per
    label: str
    family: str
    frames: Scope = "all"
    copy_as: str | None = None


@dataclass(frozen=True)
class Suite:
    """A named list of cells."""

    name: str
    cells: tuple[Cell, ...] = field(repr=False)


def _each(attack: str, per: Per, label: str, family: str = "", **parameters: Any) -> Cell:
    """Make a cell of an attack that does not take `per` as a parameter."""
    return Cell(attack, parameters, per, label, family or attack)


def _ways(attack: str, label: str, ways: tuple[Per, ...], **parameters: Any) -> tuple[Cell, ...]:
    """Make a cell for each value of the parameter `per`."""
    return tuple(Cell(attack, {**parameters, "per": per}, per, label, attack) for per in ways)


def _first(cells: Iterable[Cell]) -> tuple[Cell, ...]:
    """Apply cells by the static protocol, to the first frame alone."""
    return tuple(
        Cell(cell.attack, cell.parameters, cell.per, cell.label, cell.family, "first")
        for cell in cells
        if cell.per == "frame" or "per" not in cell.parameters
    )


FRAME: tuple[Per, ...] = ("frame",)
ANIMATION: tuple[Per, ...] = ("animation",)
BOTH: tuple[Per, ...] = ("frame", "animation")

_NONE = (Cell(NO_ATTACK, {}, "animation", "no attack", NO_ATTACK),)


def _noise(*percents: float) -> tuple[Cell, ...]:
    return tuple(
        cell
        for percent in percents
        for cell in _ways(
            "noise",
            f"noise {percent:.2f} %",
            FRAME,
            amplitude=round(percent / 100, 6),
            kind="uniform",
        )
    )


def _quantization(*bits: int) -> tuple[Cell, ...]:
    return tuple(
        cell for b in bits for cell in _ways("quantization", f"quantization {b} bit", FRAME, bits=b)
    )


def _simplification(*percents: float) -> tuple[Cell, ...]:
    return tuple(
        cell
        for percent in percents
        for cell in _ways(
            "simplification",
            f"simplification {percent:g} %",
            BOTH,
            ratio=round(percent / 100, 6),
            method="quadric",
        )
    )


def _smoothing(*iterations: int) -> tuple[Cell, ...]:
    return tuple(
        _each("smoothing", "frame", f"smoothing {n}", iterations=n, kind="umbrella", strength=0.1)
        for n in iterations
    )


def _cropping(*percents: float) -> tuple[Cell, ...]:
    return tuple(
        cell
        for percent in percents
        for cell in _ways(
            "cropping", f"cropping {percent:g} %", BOTH, share=round(percent / 100, 6)
        )
    )


def _resampling(*factors: int) -> tuple[Cell, ...]:
    return tuple(
        _each("resample", "animation", f"temporal resampling 1/{k}", factor=k) for k in factors
    )


_SIMILARITY = _ways("similarity", "similarity transformation", BOTH)

_TSAI2014 = (
    *_NONE,
    *_noise(0.05, 0.10),
    *_quantization(10, 11),
    *_SIMILARITY,
    *_simplification(10, 30),
    *_smoothing(5, 10),
    *_cropping(10, 30),
    *_resampling(4, 2),
)

_LIRIS = (
    *_NONE,
    *_noise(0.05, 0.10, 0.30, 0.50),
    *_smoothing(5, 10, 30, 50),
    *_quantization(11, 10, 9, 8, 7),
    *_SIMILARITY,
    *_simplification(10, 30, 50, 70, 90, 95, 97.5),
    *(
        _each("subdivision", "frame", f"subdivision {scheme}", scheme=scheme, steps=1)
        for scheme in ("midpoint", "sqrt3", "loop")
    ),
    *_cropping(10, 30, 50),
    *_ways("reorder", "file re-ordering", BOTH),
)


def _combined(*steps: str) -> Cell:
    names = ", then ".join(step.partition(":")[0] for step in steps)
    return _each("combination", "animation", names, attacks="+".join(steps))


_BEYOND = (
    *_ways("noise", "Gaussian noise 0.10 %", FRAME, amplitude=0.001, kind="gaussian"),
    *_ways("noise", "noise 0.10 %, one pattern", ANIMATION, amplitude=0.001, kind="uniform"),
    *_ways("quantization", "quantization 10 bit, one box", ANIMATION, bits=10),
    _each("smoothing", "frame", "Taubin smoothing 10", iterations=10, kind="taubin", strength=0.5),
    *_ways("simplification", "fast simplification 30 %", BOTH, ratio=0.3, method="fast"),
    *(
        cell
        for edge in (1.0, 1.5)
        for cell in _ways("remeshing-isotropic", f"isotropic remeshing {edge:g}", BOTH, edge=edge)
    ),
    *(
        cell
        for cells in (128, 256)
        for cell in _ways("remeshing-sdf", f"marching cubes {cells}", BOTH, resolution=cells)
    ),
    *(
        _each("scale", "animation", f"non-uniform scale {100 * s:g} %", strength=s)
        for s in (0.05, 0.1, 0.2)
    ),
    *_resampling(2, 4, 8),
    *(
        _each("drop", "animation", f"{100 * share:g} % of the frames dropped", share=share)
        for share in (0.25, 0.5)
    ),
    *(
        _each("window", "animation", f"window of {100 * share:g} %", share=share)
        for share in (0.5, 0.25)
    ),
    *(
        _each("speed", "animation", f"speed {factor:g}", factor=factor, bake=True)
        for factor in (1.25, 0.8)
    ),
    _each("reverse", "animation", "reversed"),
    _each("float16", "frame", "half-precision positions", "format"),
    _each("obj-digits", "frame", "OBJ, 4 digits", "format", digits=4, kind="fixed"),
    *(
        _each("gltf-quantization", "animation", f"glTF, {bits} bit", "format", bits=bits)
        for bits in (16, 14, 12)
    ),
    _combined("cropping:share=0.1", "simplification:ratio=0.3", "noise:amplitude=0.001"),
    _combined("quantization:bits=12", "smoothing:iterations=5", "similarity"),
    _combined("window:share=0.5", "simplification:ratio=0.1", "similarity", "obj-digits"),
    *(
        Cell(
            "collusion",
            {"kind": kind},
            "animation",
            f"collusion, {kind}",
            "collusion",
            copy_as="other",
        )
        for kind in ("mean", "alternate")
    ),
)

# What a leaked copy is likely to have been through, mild and rough, by frame and as a whole.
_LEAKS = (
    *_NONE,
    *_noise(0.05, 0.1, 0.5),
    *_quantization(11, 10, 8, 7),
    *_ways("similarity", "similarity transformation", BOTH),
    *_smoothing(5, 10, 30, 50),
    *_simplification(10, 30, 50, 70, 90),
    *_ways("simplification", "fast simplification 50 %", BOTH, ratio=0.5, method="fast"),
    _each("subdivision", "frame", "Loop subdivision", scheme="loop"),
    *_cropping(10, 30),
    *_resampling(2, 4, 8),
    _each("window", "animation", "window of a third", share=0.333),
    _combined("reverse", "speed:factor=2,bake=true"),
    _combined(
        "cropping:share=0.1", "simplification:ratio=0.3", "similarity", "noise:amplitude=0.001"
    ),
    *_ways("remeshing-isotropic", "isotropic remeshing 1", FRAME, edge=1.0),
    *_ways("remeshing-sdf", "marching cubes 128", FRAME, resolution=128),
)

# What hides a mark at next to no cost to the shape, or would if detection let it.
_HIDING = (
    *_NONE,
    *(
        _each("joining", "animation", f"joined: {thing}", thing=thing)
        for thing in ("ground", "box", "body", "sheet", "wall")
    ),
    *(
        _each("cutting", "animation", f"cut into {patches}", patches=patches, gap=1e-6)
        for patches in (2, 12, 100)
    ),
    *(
        _each("junk", "animation", label, share=share, where=where)
        for label, share, where in (
            ("first frame scrambled", 0.01, "start"),
            ("first half scrambled", 0.5, "start"),
            ("two thirds scrambled", 0.67, "random"),
        )
    ),
    *(_each("relaxation", "frame", f"relaxation {n}", steps=n) for n in (3, 5, 10)),
    *(
        cell
        for amplitude in (0.005, 0.01, 0.02)
        for cell in _ways("wobble", f"wobble {100 * amplitude:g} %", BOTH, amplitude=amplitude)
    ),
    *(
        cell
        for size in (0.5, 1.0)
        for cell in _ways("jitter", f"jitter {size:g} edges", BOTH, size=size)
    ),
    _combined("simplification:ratio=0.75", "subdivision:scheme=midpoint"),
    _combined("smoothing:iterations=1,strength=1", "noise:amplitude=0.0005"),
    *(
        _each("marking-again", "animation", label, copies=copies)
        for label, copies in (("marked again", 1), ("mean of three marked again", 3))
    ),
)

SUITES: Mapping[str, Suite] = {
    suite.name: suite
    for suite in (
        Suite("tsai2014", _TSAI2014),
        Suite("liris", (*_first(_LIRIS), *_LIRIS)),
        Suite("animation", (*_LIRIS, *_BEYOND)),
        Suite("leaks", _LEAKS),
        Suite("hiding", _HIDING),
    )
}


def suite_named(name: str) -> Suite:
    """Return a suite.

    Raises
    ------
    UsageError
        If there is none of that name; the message lists those there are.
    """
    if name not in SUITES:
        raise UsageError(f"no suite is called {name!r}; known are: {', '.join(SUITES)}")
    return SUITES[name]


def cell_from_text(text: str) -> Cell:
    """Make a cell from "NAME:PARAMETER=VALUE,...", a semicolon standing for a comma in a value.

    An unknown attack or an impossible value is left for the cell itself to report.

    Raises
    ------
    UsageError
        If the text is not of this form.
    """
    refusal = f"--attack takes NAME:PARAMETER=VALUE,..., not {text!r}"
    name, typed = name_and_parameters(text, lambda _: refusal)
    if not name:
        raise UsageError(refusal)
    offers = {offer.name: offer for offer in catalogue().of_kind("attack")}
    offer = offers.get(name)
    parameters = {
        parameter: value if offer is None else convert(offer, parameter, value)
        for parameter, value in typed.items()
    }
    defaults = {} if offer is None else offer.record.parameters
    per: Per = "frame" if parameters.get("per", defaults.get("per")) == "frame" else "animation"
    return Cell(name, parameters, per, text.strip(), name)
