"""What the suites consist of, as data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase

from meshmark.benchmarking.suite_rows import (
    ANIMATION,
    BOTH,
    FRAME,
    NO_ATTACK,
    Cell,
    cell_of,
    cells_of,
    collusion,
    combined,
    cropping,
    isotropic_remeshing,
    marching_cubes,
    noise,
    non_uniform_scale,
    quantization,
    relaxation,
    resampling,
    simplification,
    smoothing,
    taubin,
    wobble,
)
from meshmark.errors import UsageError


@dataclass(frozen=True)
class Suite:
    """A named list of cells."""

    name: str
    cells: tuple[Cell, ...] = field(repr=False)

    def only(self, labels: Sequence[str]) -> Suite:
        """Keep the cells with these labels, in which * stands for anything; all if none is given.

        Raises
        ------
        UsageError
            If a label fits no cell.
        """
        for label in labels:
            if not any(fnmatchcase(cell.label, label) for cell in self.cells):
                raise UsageError(f"suite {self.name} has no row {label!r}")
        return replace(
            self,
            cells=tuple(
                cell
                for cell in self.cells
                if not labels or any(fnmatchcase(cell.label, label) for label in labels)
            ),
        )


_NONE = (Cell(NO_ATTACK, {}, "animation", "no attack", NO_ATTACK),)


def _first(cells: Iterable[Cell]) -> tuple[Cell, ...]:
    """Apply cells by the static protocol, to the first frame alone."""
    return tuple(
        Cell(cell.attack, cell.parameters, cell.per, cell.label, cell.family, "first")
        for cell in cells
        if cell.per == "frame" or "per" not in cell.parameters
    )


_SIMILARITY = cells_of("similarity", "similarity transformation", BOTH)

_TSAI2014 = (
    *_NONE,
    *noise(0.05, 0.10),
    *quantization(10, 11),
    *_SIMILARITY,
    *simplification(10, 30),
    *smoothing(5, 10),
    *cropping(10, 30),
    *resampling(4, 2),
)

_LIRIS = (
    *_NONE,
    *noise(0.05, 0.10, 0.30, 0.50),
    *smoothing(5, 10, 30, 50),
    *quantization(11, 10, 9, 8, 7),
    *_SIMILARITY,
    *simplification(10, 30, 50, 70, 90, 95, 97.5),
    *(
        cell_of("subdivision", "frame", f"subdivision {scheme}", scheme=scheme, steps=1)
        for scheme in ("midpoint", "sqrt3", "loop")
    ),
    *cropping(10, 30, 50),
    *cells_of("reorder", "file re-ordering", BOTH),
)


_BEYOND = (
    *cells_of("noise", "Gaussian noise 0.10 %", FRAME, amplitude=0.001, kind="gaussian"),
    *cells_of("noise", "noise 0.10 %, one pattern", ANIMATION, amplitude=0.001, kind="uniform"),
    *cells_of("quantization", "quantization 10 bit, one box", ANIMATION, bits=10),
    *taubin(10),
    *cells_of("simplification", "fast simplification 30 %", BOTH, ratio=0.3, method="fast"),
    *isotropic_remeshing(1.0, 1.5, ways=BOTH),
    *marching_cubes(128, 256, ways=BOTH),
    *non_uniform_scale(5, 10, 20),
    *resampling(2, 4, 8),
    *(
        cell_of("drop", "animation", f"{100 * share:g} % of the frames dropped", share=share)
        for share in (0.25, 0.5)
    ),
    *(
        cell_of("window", "animation", f"window of {100 * share:g} %", share=share)
        for share in (0.5, 0.25)
    ),
    *(
        cell_of("speed", "animation", f"speed {factor:g}", factor=factor, bake=True)
        for factor in (1.25, 0.8)
    ),
    cell_of("reverse", "animation", "reversed"),
    cell_of("float16", "frame", "half-precision positions", "format"),
    cell_of("obj-digits", "frame", "OBJ, 4 digits", "format", digits=4, kind="fixed"),
    *(
        cell_of("gltf-quantization", "animation", f"glTF, {bits} bit", "format", bits=bits)
        for bits in (16, 14, 12)
    ),
    combined("cropping:share=0.1", "simplification:ratio=0.3", "noise:amplitude=0.001"),
    combined("quantization:bits=12", "smoothing:iterations=5", "similarity"),
    combined("window:share=0.5", "simplification:ratio=0.1", "similarity", "obj-digits"),
    *collusion("mean", 2),
    *collusion("alternate", 2),
)

# What a leaked copy is likely to have been through, mild and rough, by frame and as a whole.
_LEAKS = (
    *_NONE,
    *noise(0.05, 0.1, 0.5),
    *quantization(11, 10, 8, 7),
    *cells_of("similarity", "similarity transformation", BOTH),
    *smoothing(5, 10, 30, 50),
    *simplification(10, 30, 50, 70, 90),
    *cells_of("simplification", "fast simplification 50 %", BOTH, ratio=0.5, method="fast"),
    cell_of("subdivision", "frame", "Loop subdivision", scheme="loop"),
    *cropping(10, 30),
    *resampling(2, 4, 8),
    cell_of("window", "animation", "window of a third", share=0.333),
    combined("reverse", "speed:factor=2,bake=true"),
    combined(
        "cropping:share=0.1", "simplification:ratio=0.3", "similarity", "noise:amplitude=0.001"
    ),
    *isotropic_remeshing(1.0, ways=FRAME),
    *marching_cubes(128, ways=FRAME),
)


# What moves vertices on the surface, or rebuilds it, and hardly changes the shape.
_DENSITY = (
    *(
        cell
        for size in (0.5, 1.0)
        for cell in cells_of("jitter", f"jitter {size:g} edges", BOTH, size=size)
    ),
    combined(
        "simplification:ratio=0.75",
        "subdivision:scheme=midpoint",
        label="simplification 75 %, then midpoint",
    ),
    combined("smoothing:iterations=1,strength=1", "noise:amplitude=0.0005"),
    *(
        cell_of("marking-again", "animation", label, copies=copies)
        for label, copies in (("marked again", 1), ("mean of three marked again", 3))
    ),
)

# What hides a mark at next to no cost to the shape, or would if detection let it.
_HIDING = (
    *_NONE,
    *(
        cell_of("joining", "animation", f"joined: {thing}", thing=thing)
        for thing in ("ground", "box", "body", "sheet", "wall")
    ),
    *(
        cell_of("cutting", "animation", f"cut into {patches}", patches=patches, gap=1e-6)
        for patches in (2, 12, 100)
    ),
    *(
        cell_of("junk", "animation", label, share=share, where=where)
        for label, share, where in (
            ("first frame scrambled", 0.01, "start"),
            ("first half scrambled", 0.5, "start"),
            ("two thirds scrambled", 0.67, "random"),
        )
    ),
    *relaxation(3, 5, 10),
    *wobble(0.5, 1, 2),
    *_DENSITY,
)

# What is tried on a mark that is read against the original: a leak's way, rougher; what ends a
# blind mark; a relief on top of the mark's own; and crowds of recipients.
_INFORMED = (
    *_LEAKS,
    *cropping(50, 80),
    *cells_of("simplification", "simplification 97.5 %", FRAME, ratio=0.975, method="quadric"),
    combined(
        "simplification:ratio=0.9",
        "subdivision:scheme=loop",
        label="simplification 90 %, then Loop",
    ),
    cell_of("subdivision", "frame", "Catmull-Clark subdivision", scheme="catmull_clark"),
    *isotropic_remeshing(2.0, ways=FRAME),
    *marching_cubes(64, ways=FRAME),
    *taubin(10, 50),
    *(
        cell
        for percent in (1, 3)
        for cell in cells_of("bending", f"bend {percent} %", BOTH, amount=percent / 100)
    ),
    *non_uniform_scale(2, 5),
    cell_of("scale", "animation", "mirror", factors=(-1.0, 1.0, 1.0)),
    *(
        cell_of(
            "embossing",
            "animation",
            f"random relief {height:g}, {patches} patches",
            height=height,
            patches=patches,
        )
        for patches in (400, 1600)
        for height in (1e-4, 3e-4, 1e-3)
    ),
    *relaxation(3, 5, 10, 30),
    *wobble(1),
    *_DENSITY,
    # The median of two is their mean.
    *collusion("mean", 2, 3, 5, 10, 20),
    *collusion("median", 3, 5, 10, 20),
    *(
        cell
        for kind in ("min", "max", "choice", "extremes")
        for cell in collusion(kind, 2, 3, 5, 10, 20)
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
        Suite("informed", _INFORMED),
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
