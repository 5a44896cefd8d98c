"""Open stages, kept open for a while in each process, and the files a stage is made of."""

from __future__ import annotations

import math
import os
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pxr import Ar, Usd, UsdUtils

from meshmark.errors import InputError, UsageError
from meshmark.mesh.topology import Topology
from meshmark.usd.diagnostics import caught
from meshmark.usd.points import StagePoints
from meshmark.usd.variants import Choice, chosen, select

# A process works on one source at a time, two when it compares; every stage held costs memory.
KEPT_OPEN = 4


@dataclass(frozen=True)
class OpenStage:
    """A stage, what pxr said while opening it, its points, and topologies already read from it.

    It tells which variants were selected in it that it does not select itself.

    The stage is shared by everybody in the process who reads that file: it must not be edited.
    """

    stage: Usd.Stage
    warnings: tuple[str, ...]
    points: StagePoints
    variants: tuple[str, ...] = ()
    topologies: dict[str, Topology] = field(default_factory=dict)


_open: OrderedDict[tuple[object, ...], tuple[tuple[int, ...], OpenStage]] = OrderedDict()


def open_stage(source: str, variants: Sequence[str] = ()) -> OpenStage:
    """Open a stage, or return the one this process already has open.

    A file that has changed on disk since is opened again.

    Parameters
    ----------
    source : str
        The file.
    variants : sequence of str
        What to select in it that it does not select itself, each `PRIM{SET=NAME}`.

    Raises
    ------
    InputError
        If there is no such file, or pxr cannot read it.
    """
    path = _existing_file(source)
    # A forked child must not use the stage its parent opened: pxr's threads did not survive.
    key = (os.getpid(), str(path.absolute()), *variants)
    stamp = _stamp(path)
    kept = _open.pop(key, None)
    if kept is None or kept[0] != stamp:
        # Layers live as long as a stage holds them: the old one must go before the new is opened.
        del kept
        kept = (stamp, _opened(source, variants))
    _open[key] = kept
    while len(_open) > KEPT_OPEN:
        _open.popitem(last=False)
    return kept[1]


def resolved(source: str, asked: Sequence[str], *, strict: bool = True) -> tuple[str, ...]:
    """Say which sets of which prims variants that are asked for select; see `variants.chosen`."""
    if not asked:
        return ()
    _existing_file(source)
    try:
        with caught(source):
            return tuple(map(str, chosen(Usd.Stage.Open(source), asked, strict=strict)))
    except UsageError as error:
        raise UsageError(error.message, source=source) from None


def stage_files(source: str) -> list[Path]:
    """List the files a stage is composed from: its own first, the others by name.

    Every layer that can contribute counts: sublayers, references, payloads, value clips, and
    those of variants that are not selected. A package counts as one file. Textures do not.

    Raises
    ------
    InputError
        If the source cannot be read.
    """
    path = _existing_file(source)
    with caught(source):
        layers, _, _ = UsdUtils.ComputeAllDependencies(str(path))
        names = {layer.realPath for layer in layers}
    # A layer inside a package is named package.usdz[inner.usdc]: the package is the file.
    outer = {Ar.SplitPackageRelativePathOuter(name)[0] for name in names if name}
    own = path.resolve()
    return [own, *sorted({Path(name).resolve() for name in outer} - {own})]


def _opened(source: str, variants: Sequence[str]) -> OpenStage:
    with caught(source) as warnings:
        stage = Usd.Stage.Open(source)
        reload_changed(stage)
        _require_time(stage, source)
        select(stage, map(Choice.parse, variants))
    return OpenStage(stage, tuple(warnings), StagePoints(stage), tuple(variants))


def reload_changed(stage: Usd.Stage) -> None:
    """Read layers again that changed on disk since somebody else in this process opened them.

    pxr gives everybody the same layer of a file for as long as anybody holds it, as the program
    may that publishes. What somebody is editing stays as it is.
    """
    for layer in stage.GetUsedLayers():
        if not (layer.anonymous or layer.dirty):
            layer.Reload()


def _require_time(stage: Usd.Stage, source: str) -> None:
    """Refuse layers between whose times nothing converts: pxr looks for samples for ever."""
    layers = set(stage.GetUsedLayers()) - {stage.GetSessionLayer()}
    rates = {abs(layer.timeCodesPerSecond) for layer in layers}
    if len(rates) < 2:
        return
    if not all(0.0 < rate < math.inf for rate in rates) or max(rates) / min(rates) == math.inf:
        told = ", ".join(f"{rate:g}" for rate in sorted(rates))
        raise InputError(
            f"times of its layers do not convert: timeCodesPerSecond are {told}", source=source
        )


def _existing_file(source: str) -> Path:
    path = Path(source)
    if not path.exists():
        raise InputError("no such file", source=source)
    if not path.is_file():
        raise InputError("not a file", source=source)
    return path


def _stamp(path: Path) -> tuple[int, ...]:
    status = path.stat()
    return (status.st_mtime_ns, status.st_size, status.st_ino)
