"""Where in an override layer points go: at their prim, or inside the variants that shape it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain, combinations
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from meshmark.errors import InputError, OutputError
from meshmark.mesh.asset import Asset
from meshmark.usd.blend_shapes import TARGETS, equal_shapes
from meshmark.usd.diagnostics import caught
from meshmark.usd.geometry import sample_times, time_code
from meshmark.usd.layers import copy_stage_metadata, set_value
from meshmark.usd.points import MeshPoints, StagePoints
from meshmark.usd.primvars import different
from meshmark.usd.variants import Choice, select, selections, write_selections

CLIPS = Usd.ResolveInfoSourceValueClips
# Points that no mesh has.
SENTINEL = Vt.Vec3fArray([(0.25, -0.125, 1e30)])


@dataclass(frozen=True)
class Place:
    """Where the marked points of a mesh are written.

    Parameters
    ----------
    path : Sdf.Path
        Of the spec of the mesh; it goes through `variants`.
    variants : tuple of Choice
        The selected variants without which the mesh has another shape, or is not there.
    others : tuple of Choice
        The other variants of their sets: in them, nothing changes.
    elsewhere : frozenset of str
        Primvars, normals, and targets of blend shapes, that are others in variants for which the
        points are the same.
    """

    path: Sdf.Path
    variants: tuple[Choice, ...] = ()
    others: tuple[Choice, ...] = ()
    elsewhere: frozenset[str] = frozenset()


def find_places(
    original: Asset, points: StagePoints, prims: Iterable[Usd.Prim]
) -> dict[str, Place]:
    """Find the place of each of some meshes.

    A mesh whose points are the same whatever is selected is written at its prim, for all variants.
    Points that depend on a variant are written inside that variant: anywhere else, they would be
    put upon the shapes of the others, too.

    Parameters
    ----------
    original : Asset
        As read by `read_stage`; only where it was read from, and with which variants, matters.
    points : StagePoints
        Of its stage.
    prims : iterable of Usd.Prim
        The meshes.

    Raises
    ------
    OutputError
        If something in the source is stronger than any layer can be inside a variant.
    """
    found = {str(prim.GetPath()): Place(prim.GetPath()) for prim in prims}
    with caught(original.source):
        shaping, elsewhere = _shaping(original, points, found)
        trial = _Trial(original, points.stage, list(shaping))
        for path, choices in shaping.items():
            chosen = tuple(choice for choice, _ in choices)
            others = tuple(Choice(c.prim, c.set, name) for c, names in choices for name in names)
            found[path] = Place(trial.place(path, chosen, others), chosen, others)
    return {
        path: replace(place, elsewhere=frozenset(elsewhere.get(path, ())))
        for path, place in found.items()
    }


def _shaping(
    original: Asset, points: StagePoints, paths: Iterable[str]
) -> tuple[dict[str, list[tuple[Choice, list[str]]]], dict[str, set[str]]]:
    """Map each mesh that variants shape to these, the outermost first, and their alternatives.

    And each mesh to what hangs on its points that others change.
    """
    offered = {path: selections(points.stage.GetPrimAtPath(path)) for path in paths}
    pairs = dict.fromkeys(
        (choice, name) for each in offered.values() for choice, names in each for name in names
    )
    if not pairs:
        return {}, {}
    elsewhere: dict[str, set[str]] = {path: set() for path in offered}
    matters: dict[str, set[Choice]] = {path: set() for path in offered}
    stage = Usd.Stage.Open(original.source)
    for choice, name in pairs:
        with _selected(stage, [*original.variants, str(Choice(choice.prim, choice.set, name))]):
            others = StagePoints(stage)
            for path, each in offered.items():
                if choice in matters[path] or all(choice != known for known, _ in each):
                    continue
                own = points.of(points.stage.GetPrimAtPath(path))
                if _alike(own, stage.GetPrimAtPath(path), others):
                    elsewhere[path] |= different(own.prim, stage.GetPrimAtPath(path))
                    if not equal_shapes(own.prim, stage.GetPrimAtPath(path)):
                        elsewhere[path].add(TARGETS)
                else:
                    matters[path].add(choice)
    shaping = {
        path: [(choice, names) for choice, names in each if choice in matters[path]]
        for path, each in offered.items()
    }
    return {path: choices for path, choices in shaping.items() if choices}, elsewhere


@contextmanager
def _selected(stage: Usd.Stage, variants: Iterable[str]) -> Iterator[None]:
    """Select variants in the session layer of a stage meanwhile; of one set, the last."""
    before = stage.GetSessionLayer().ExportToString()
    select(stage, map(Choice.parse, variants))
    yield
    stage.GetSessionLayer().ImportFromString(before)


def _alike(own: MeshPoints, prim: Usd.Prim, others: StagePoints) -> bool:
    """Tell whether a mesh shows the same points, posed, at the same times in another stage."""
    if not _is_mesh(prim):
        return False
    try:
        theirs = others.of(prim)
        if own.rig is None and theirs.rig is None and _opinions(own.prim) == _opinions(prim):
            return True
        times = own.times()
        return np.array_equal(times, theirs.times(), equal_nan=True) and all(
            np.array_equal(own.local(time), theirs.local(time)) for time in times.tolist()
        )
    except InputError:
        return False


def _opinions(prim: Usd.Prim) -> object:
    """Return what tells where the points of a mesh come from; never equal for value clips."""
    points = UsdGeom.Mesh(prim).GetPointsAttr()
    if points.GetResolveInfo(Usd.TimeCode.EarliestTime()).GetSource() == CLIPS:
        return object()
    specs = points.GetPropertyStackWithLayerOffsets()
    return [(spec.layer.identifier, spec.path, offset) for spec, offset in specs]


def _is_mesh(prim: Usd.Prim) -> bool:
    return bool(prim and prim.IsActive() and prim.IsDefined() and prim.IsA(UsdGeom.Mesh))


class _Trial:
    """A layer over a stage, to find out where in it points win."""

    def __init__(self, original: Asset, stage: Usd.Stage, paths: list[str]) -> None:
        self._source = original.source
        self._layer = Sdf.Layer.CreateAnonymous(".usda")
        copy_stage_metadata(stage.GetRootLayer(), self._layer)
        self._layer.subLayerPaths.append(Path(original.source).absolute().as_posix())
        write_selections(self._layer, map(Choice.parse, original.variants))
        self._stage = Usd.Stage.OpenMasked(self._layer, Usd.StagePopulationMask(paths))
        self._own = self._layer.ExportToString()

    def place(
        self, path: str, variants: tuple[Choice, ...], others: tuple[Choice, ...]
    ) -> Sdf.Path:
        """Return a path through variants where points of a mesh win, and only if all are selected.

        What is inside several may be weaker than what is inside one, which others come with.
        """
        sizes = range(len(variants), 0, -1)
        for through in chain.from_iterable(combinations(variants, size) for size in sizes):
            place = _through(Sdf.Path(path), through)
            if self._wins(path, place, others):
                return place
        told = " and ".join(map(str, variants))
        raise OutputError(
            f"its shape depends on {told}, and is said where no layer can override it for that "
            "variant alone; write a flattened deliverable instead",
            source=self._source,
            prim=path,
        )

    def _wins(self, path: str, place: Sdf.Path, others: tuple[Choice, ...]) -> bool:
        time = float(sample_times(self._stage.GetPrimAtPath(path))[0])
        spec = over(self._layer, place, self._stage)
        points = Sdf.AttributeSpec(spec, "points", Sdf.ValueTypeNames.Point3fArray)
        set_value(self._layer, points.path, time, SENTINEL)
        wins = self._shows(path, time)
        for each in others:
            with _selected(self._stage, [str(each)]):
                wins = wins and not self._shows(path, time)
        self._layer.ImportFromString(self._own)
        return wins

    def _shows(self, path: str, time: float) -> bool:
        prim = self._stage.GetPrimAtPath(path)
        shown = UsdGeom.Mesh(prim).GetPointsAttr().Get(time_code(time)) if _is_mesh(prim) else None
        return bool(shown == SENTINEL)


def over(layer: Sdf.Layer, place: Sdf.Path, stage: Usd.Stage) -> Sdf.PrimSpec:
    """Make the spec of a mesh in a layer, and keep the order of the sets of variants around it.

    Of several sets the first is the strongest; whoever adds to one would put it first.
    """
    spec = Sdf.CreatePrimInLayer(layer, place)
    for prefix in place.GetPrefixes():
        if not prefix.IsPrimVariantSelectionPath():
            continue
        owner = layer.GetPrimAtPath(prefix.GetParentPath())
        prim = stage.GetPrimAtPath(prefix.StripAllVariantSelections())
        around = _sets_around(prefix.GetParentPath())
        names = [each for each in prim.GetVariantSets().GetNames() if each not in around]
        owner.variantSetNameList.prependedItems = names
    return spec


def _sets_around(path: Sdf.Path) -> set[str]:
    """Name the sets of the same prim whose variants a path ends in."""
    found: set[str] = set()
    while path.IsPrimVariantSelectionPath():
        found.add(path.GetVariantSelection()[0])
        path = path.GetParentPath()
    return found


def _through(path: Sdf.Path, variants: Iterable[Choice]) -> Sdf.Path:
    """Let the path of a prim go through variants, the outermost first."""
    for each in reversed(list(variants)):
        inside = Sdf.Path(each.prim).AppendVariantSelection(each.set, each.name)
        path = path.ReplacePrefix(Sdf.Path(each.prim), inside)
    return path
