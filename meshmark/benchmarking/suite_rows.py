"""Rows of suites: an attack with its parameters, and its name in the tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from meshmark.errors import UsageError
from meshmark.extension.parameters import name_and_parameters
from meshmark.extension.recipe import convert
from meshmark.extension.registry import catalogue

Per = Literal["frame", "animation"]
Scope = Literal["all", "first"]

NO_ATTACK = "none"

FRAME: tuple[Per, ...] = ("frame",)
ANIMATION: tuple[Per, ...] = ("animation",)
BOTH: tuple[Per, ...] = ("frame", "animation")


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
    others : int
        How many more, differently marked copies the attack is given, as its parameter `other`.
    """

    attack: str
    parameters: Mapping[str, Any]
    per: Per
    label: str
    family: str
    frames: Scope = "all"
    others: int = 0


def cell_of(attack: str, per: Per, label: str, family: str = "", **parameters: Any) -> Cell:
    """Make a cell of an attack that does not take `per` as a parameter."""
    return Cell(attack, parameters, per, label, family or attack)


def cells_of(attack: str, label: str, ways: tuple[Per, ...], **parameters: Any) -> tuple[Cell, ...]:
    """Make a cell for each value of the parameter `per`."""
    return tuple(Cell(attack, {**parameters, "per": per}, per, label, attack) for per in ways)


def noise(*percents: float) -> tuple[Cell, ...]:
    """Noise of some shares of the mean distance to the centre, new in every frame."""
    return tuple(
        cell
        for percent in percents
        for cell in cells_of(
            "noise",
            f"noise {percent:.2f} %",
            FRAME,
            amplitude=round(percent / 100, 6),
            kind="uniform",
        )
    )


def quantization(*bits: int) -> tuple[Cell, ...]:
    """Round to grids of some numbers of bits."""
    return tuple(
        cell
        for b in bits
        for cell in cells_of("quantization", f"quantization {b} bit", FRAME, bits=b)
    )


def simplification(*percents: float) -> tuple[Cell, ...]:
    """Remove some shares of the edges, by frame and as a whole."""
    return tuple(
        cell
        for percent in percents
        for cell in cells_of(
            "simplification",
            f"simplification {percent:g} %",
            BOTH,
            ratio=round(percent / 100, 6),
            method="quadric",
        )
    )


def smoothing(*iterations: int) -> tuple[Cell, ...]:
    """Smooth by some numbers of umbrella steps."""
    return tuple(
        cell_of("smoothing", "frame", f"smoothing {n}", iterations=n, kind="umbrella", strength=0.1)
        for n in iterations
    )


def cropping(*percents: float) -> tuple[Cell, ...]:
    """Cut some shares of the vertices away, by frame and as a whole."""
    return tuple(
        cell
        for percent in percents
        for cell in cells_of(
            "cropping", f"cropping {percent:g} %", BOTH, share=round(percent / 100, 6)
        )
    )


def resampling(*factors: int) -> tuple[Cell, ...]:
    """Lower the frame rate to some fractions, and raise it again."""
    return tuple(
        cell_of("resample", "animation", f"temporal resampling 1/{k}", factor=k) for k in factors
    )


def combined(*steps: str, label: str = "") -> Cell:
    """Apply several attacks in a row."""
    names = ", then ".join(step.partition(":")[0] for step in steps)
    return cell_of("combination", "animation", label or names, attacks="+".join(steps))


def marching_cubes(*cells: int, ways: tuple[Per, ...]) -> tuple[Cell, ...]:
    """Remesh on grids of some numbers of cells."""
    return tuple(
        cell
        for n in cells
        for cell in cells_of("remeshing-sdf", f"marching cubes {n}", ways, resolution=n)
    )


def isotropic_remeshing(*edges: float, ways: tuple[Per, ...]) -> tuple[Cell, ...]:
    """Remesh to some multiples of the mean edge length."""
    return tuple(
        cell
        for edge in edges
        for cell in cells_of(
            "remeshing-isotropic", f"isotropic remeshing {edge:g}", ways, edge=edge
        )
    )


def non_uniform_scale(*percents: float) -> tuple[Cell, ...]:
    """Scale each axis by up to some shares."""
    return tuple(
        cell_of("scale", "animation", f"non-uniform scale {percent:g} %", strength=percent / 100)
        for percent in percents
    )


def taubin(*iterations: int) -> tuple[Cell, ...]:
    """Smooth by some numbers of Taubin's steps."""
    return tuple(
        cell_of(
            "smoothing", "frame", f"Taubin smoothing {n}", iterations=n, kind="taubin", strength=0.5
        )
        for n in iterations
    )


def collusion(kind: str, *copies: int) -> tuple[Cell, ...]:
    """Blend some numbers of copies."""
    return tuple(
        Cell(
            "collusion",
            {"kind": kind},
            "animation",
            f"collusion of {n}, {kind}",
            "collusion",
            others=n - 1,
        )
        for n in copies
    )


def relaxation(*steps: int) -> tuple[Cell, ...]:
    """Even vertices out on the surface in some numbers of steps."""
    return tuple(cell_of("relaxation", "frame", f"relaxation {n}", steps=n) for n in steps)


def wobble(*percents: float) -> tuple[Cell, ...]:
    """Displace by waves of some shares of the mean distance to the centre."""
    return tuple(
        cell
        for percent in percents
        for cell in cells_of("wobble", f"wobble {percent:g} %", BOTH, amplitude=percent / 100)
    )


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
