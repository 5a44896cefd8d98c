"""Where points in a layer win: found out by trying, with points that no mesh has."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from itertools import combinations
from pathlib import Path

from pxr import Sdf, Usd, UsdGeom, Vt

from meshmark.errors import OutputError
from meshmark.mesh.asset import Asset
from meshmark.usd.geometry import sample_times, time_code
from meshmark.usd.instances import Classes
from meshmark.usd.layers import copy_stage_metadata, set_value
from meshmark.usd.specs import NO_CLASSES, author_classes, over
from meshmark.usd.variants import Choice, select, write_selections

# Points that no mesh has.
SENTINEL = Vt.Vec3fArray([(0.25, -0.125, 1e30)])


@contextmanager
def selected(stage: Usd.Stage, variants: Iterable[str]) -> Iterator[None]:
    """Select variants in the session layer of a stage meanwhile; of one set, the last."""
    before = stage.GetSessionLayer().ExportToString()
    select(stage, map(Choice.parse, variants))
    yield
    stage.GetSessionLayer().ImportFromString(before)


def is_mesh(prim: Usd.Prim) -> bool:
    """Tell whether a stage shows a mesh there."""
    return bool(prim and prim.IsActive() and prim.IsDefined() and prim.IsA(UsdGeom.Mesh))


class Trial:
    """A layer over a stage, to find out where in it points win."""

    def __init__(self, original: Asset, stage: Usd.Stage, paths: list[str]) -> None:
        self._source = original.source
        self._layer = Sdf.Layer.CreateAnonymous(".usda")
        copy_stage_metadata(stage.GetRootLayer(), self._layer)
        self._layer.subLayerPaths.append(Path(original.source).absolute().as_posix())
        write_selections(self._layer, map(Choice.parse, original.variants))
        self._stage = Usd.Stage.OpenMasked(self._layer, Usd.StagePopulationMask(paths))
        self._own = self._layer.ExportToString()

    def of_mesh(
        self, prim: Usd.Prim, variants: tuple[Choice, ...], others: tuple[Choice, ...]
    ) -> Sdf.Path:
        """Return a path through variants where points of a mesh win, and only if all are selected.

        What is inside several may be weaker than what is inside one, which others come with.
        """
        for place in _through_some(prim.GetPath(), variants):
            write = partial(self._write, NO_CLASSES, {place: prim})
            if self._wins([prim], write, others):
                return place
        raise self._beaten(prim.GetPath(), variants)

    def of_instance(
        self,
        instance: Sdf.Path,
        variants: tuple[Choice, ...],
        others: tuple[Choice, ...],
        classes: Classes,
        meshes: list[Usd.Prim],
    ) -> Classes:
        """Return classes that win in an instance, and only if all variants are selected.

        What an instance says in variants of its own is no other's: instances would not share a
        prototype any more. So their class has variants, of the same sets.
        """
        own = [(each.set, each.name) for each in variants if each.prim == str(instance)]
        around = tuple(each for each in variants if each.prim != str(instance))
        classes = classes.in_variants(self._stage.GetPrimAtPath(instance), own)
        for place in _through_some(instance, around) if around else [instance]:
            found = classes.linked_at(instance, place)
            specs = {found.spec(mesh): mesh for mesh in meshes}
            if self._wins(meshes, partial(self._write, found, specs), others):
                return found
        raise self._beaten(instance, variants)

    def reached(self, classes: Classes, meshes: Iterable[Usd.Prim]) -> set[Sdf.Path]:
        """Return the specs in classes whose points win in all meshes that show them."""
        every = [(classes.spec(mesh), mesh) for mesh in meshes]
        self._write(classes, dict(every))
        beaten = {spec for spec, mesh in every if not self._shows(mesh)}
        self._layer.ImportFromString(self._own)
        return {spec for spec, _ in every} - beaten

    def _beaten(self, path: Sdf.Path, variants: tuple[Choice, ...]) -> OutputError:
        told = " and ".join(map(str, variants))
        return OutputError(
            f"its shape depends on {told}, and is said where no layer can override it for that "
            "variant alone; write a flattened deliverable instead",
            source=self._source,
            prim=str(path),
        )

    def _wins(
        self, meshes: list[Usd.Prim], write: Callable[[], None], others: tuple[Choice, ...]
    ) -> bool:
        write()
        wins = all(map(self._shows, meshes))
        for each in others:
            with selected(self._stage, [str(each)]):
                wins = wins and not any(map(self._shows, meshes))
        self._layer.ImportFromString(self._own)
        return wins

    def _write(self, classes: Classes, specs: Mapping[Sdf.Path, Usd.Prim]) -> None:
        author_classes(self._layer, classes, self._stage)
        for place, mesh in specs.items():
            spec = over(self._layer, place, self._stage, classes)
            points = Sdf.AttributeSpec(spec, "points", Sdf.ValueTypeNames.Point3fArray)
            set_value(self._layer, points.path, _first_time(mesh), SENTINEL)

    def _shows(self, mesh: Usd.Prim) -> bool:
        prim = self._stage.GetPrimAtPath(mesh.GetPath())
        code = time_code(_first_time(mesh))
        shown = UsdGeom.Mesh(prim).GetPointsAttr().Get(code) if is_mesh(prim) else None
        return bool(shown == SENTINEL)


def _first_time(mesh: Usd.Prim) -> float:
    return float(sample_times(mesh)[0])


def _through_some(path: Sdf.Path, variants: tuple[Choice, ...]) -> Iterator[Sdf.Path]:
    """Let a path go through all variants, then through fewer."""
    for size in range(len(variants), 0, -1):
        for some in combinations(variants, size):
            yield _through(path, some)


def _through(path: Sdf.Path, variants: Iterable[Choice]) -> Sdf.Path:
    """Let the path of a prim go through variants, the outermost first."""
    for each in reversed(list(variants)):
        inside = Sdf.Path(each.prim).AppendVariantSelection(each.set, each.name)
        path = path.ReplacePrefix(Sdf.Path(each.prim), inside)
    return path
