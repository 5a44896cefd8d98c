"""Where in an override layer points go: at their prim, in variants that shape it, in classes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from meshmark.errors import InputError
from meshmark.mesh.asset import Asset
from meshmark.usd.blend_shapes import TARGETS, equal_shapes
from meshmark.usd.diagnostics import caught
from meshmark.usd.instances import Classes
from meshmark.usd.points import MeshPoints, StagePoints
from meshmark.usd.primvars import different
from meshmark.usd.specs import NO_CLASSES
from meshmark.usd.trial import Trial, is_mesh, selected
from meshmark.usd.variants import Choice, selections

CLIPS = Usd.ResolveInfoSourceValueClips


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


@dataclass(frozen=True, eq=False)
class Places:
    """Where the marked points of meshes are written.

    Parameters
    ----------
    found : mapping of str to Place
        By the paths of the meshes.
    classes : Classes
        Of those inside instances.
    """

    found: Mapping[str, Place]
    classes: Classes


def find_places(original: Asset, points: StagePoints, prims: Iterable[Usd.Prim]) -> Places:
    """Find the place of each of some meshes.

    A mesh whose points are the same whatever is selected is written at its prim, for all variants.
    Points that depend on a variant are written inside that variant: anywhere else, they would be
    put upon the shapes of the others, too. Points inside instances are written in a class, which
    the instances inherit, in a variant if that shapes them. Those of which something says more
    than a class can have no place.

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
    every, stage = list(prims), points.stage
    inside = [prim for prim in every if prim.IsInstanceProxy()]
    outside = [prim for prim in every if not prim.IsInstanceProxy()]
    classes = Classes.for_prims(stage, inside, original.source) if inside else NO_CLASSES
    shown = classes.shown(stage, inside)
    like = _like(stage, classes, shown)
    with caught(original.source):
        tried = [meshes for instance, meshes in shown.items() if like[instance] == instance]
        asked = [str(prim.GetPath()) for prim in chain(outside, *tried)]
        shaping, elsewhere = _shaping(original, points, asked)
        shaped = [str(prim.GetPath()) for prim in outside if str(prim.GetPath()) in shaping]
        trial = Trial(original, stage, [*shaped, *map(str, shown)])
        found: dict[str, Place] = {}
        for prim in outside:
            path = str(prim.GetPath())
            chosen, others = _split(shaping.get(path, ()))
            place = trial.of_mesh(prim, chosen, others) if chosen else prim.GetPath()
            found[path] = Place(place, chosen, others, frozenset(elsewhere.get(path, ())))
        held: dict[Sdf.Path, Place] = {}
        for instance, meshes in shown.items():
            model = like[instance]
            paths = [str(mesh.GetPath().ReplacePrefix(instance, model)) for mesh in meshes]
            choices = {each: names for p in paths for each, names in shaping.get(p, ())}
            chosen, others = _split(choices.items())
            if chosen and model == instance:
                classes = trial.of_instance(instance, chosen, others, classes, meshes)
            for mesh, path in zip(meshes, paths, strict=True):
                own = Place(
                    mesh.GetPath(),
                    _of(chosen, model, instance),
                    _of(others, model, instance),
                    frozenset(elsewhere.get(path, ())),
                )
                inner = mesh.GetPrimInPrototype().GetPath()
                held[inner] = _both(held.get(inner, own), own)
        reached = trial.reached(classes, chain(*shown.values()))
        for prim in inside:
            if (spec := classes.spec(prim)) in reached:
                place = held[prim.GetPrimInPrototype().GetPath()]
                found[str(prim.GetPath())] = replace(place, path=spec)
    return Places(found, classes)


def _like(
    stage: Usd.Stage, classes: Classes, instances: Iterable[Sdf.Path]
) -> dict[Sdf.Path, Sdf.Path]:
    """Map each instance to one whose variants do the same, so that a crowd is not tried one by one.

    They share a prototype, and have no variants but those of what they show.
    """
    found: dict[Sdf.Path, Sdf.Path] = {}
    first: dict[Sdf.Path, Sdf.Path] = {}
    for instance in instances:
        own = [
            spec for spec in stage.GetPrimAtPath(instance).GetPrimStack() if spec.path == instance
        ]
        above = (stage.GetPrimAtPath(path) for path in instance.GetParentPath().GetPrefixes())
        others = any(len(spec.variantSets) for spec in own)
        if others or any(prim.HasVariantSets() for prim in above):
            found[instance] = instance
        else:
            found[instance] = first.setdefault(classes.prototypes[instance], instance)
    return found


def _of(choices: tuple[Choice, ...], model: Sdf.Path, instance: Sdf.Path) -> tuple[Choice, ...]:
    """Return choices of one instance as those of another."""
    return tuple(
        replace(each, prim=str(instance)) if each.prim == str(model) else each for each in choices
    )


def _split(
    choices: Iterable[tuple[Choice, list[str]]],
) -> tuple[tuple[Choice, ...], tuple[Choice, ...]]:
    """Return the variants that shape a mesh, and the others of their sets."""
    pairs = list(choices)
    others = (Choice(each.prim, each.set, name) for each, names in pairs for name in names)
    return tuple(each for each, _ in pairs), tuple(others)


def _both(one: Place, other: Place) -> Place:
    """Put together what two instances say of one spec."""
    return Place(
        one.path,
        tuple(dict.fromkeys((*one.variants, *other.variants))),
        tuple(dict.fromkeys((*one.others, *other.others))),
        one.elsewhere | other.elsewhere,
    )


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
        with selected(stage, [*original.variants, str(Choice(choice.prim, choice.set, name))]):
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


def _alike(own: MeshPoints, prim: Usd.Prim, others: StagePoints) -> bool:
    """Tell whether a mesh shows the same points, posed, at the same times in another stage."""
    if not is_mesh(prim):
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
