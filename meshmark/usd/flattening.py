"""A stage as one layer that holds only what the stage shows."""

from __future__ import annotations

from collections.abc import Iterator

from pxr import Sdf, Usd, UsdGeom


def make_instances_editable(stage: Usd.Stage) -> None:
    """Turn every instance of a stage into ordinary prims, in its session layer.

    What is said in the root layer about the prims inside then takes effect.
    """
    stage.SetEditTarget(stage.GetSessionLayer())
    # An instance inside a prototype comes into sight only when the one around it is gone.
    while instances := [prim for prim in stage.TraverseAll() if prim.IsInstance()]:
        with Sdf.ChangeBlock():
            for prim in instances:
                spec = Sdf.CreatePrimInLayer(stage.GetSessionLayer(), prim.GetPath())
                spec.instanceable = False


def flattened(stage: Usd.Stage) -> Sdf.Layer:
    """Flatten a stage without instances into an anonymous layer.

    Flattening keeps classes and pure overs, whose points may be an unmarked pose of what
    inherits from them. Nothing refers to them any more, except point instancers: their
    prototypes stay.
    """
    # The comment it could add would name the unmarked source, and a folder of this machine.
    layer = stage.Flatten(addSourceFileComment=False)
    _restore_precision(stage, layer)
    _restore_cleared_targets(stage, layer)
    kept = _prototypes(layer)
    hidden = [prim for prim in _prims(layer.pseudoRoot) if prim.specifier != Sdf.SpecifierDef]
    for prim in hidden:
        if prim and not any(_related(prim.path, prototype) for prototype in kept):
            parent = layer.GetPrimAtPath(prim.path.GetParentPath())
            del parent.nameChildren[prim.name]
    for prim in _prims(layer.pseudoRoot):
        prim.ClearInfo("instanceable")
    return layer


def _restore_precision(stage: Usd.Stage, layer: Sdf.Layer) -> None:
    """Give points the type they have in the stage: flattening makes all of them float3."""
    for prim in stage.Traverse():
        points = prim.GetAttribute(UsdGeom.Tokens.points)
        spec = layer.GetAttributeAtPath(points.GetPath())
        if spec is None:
            continue
        stored = points.GetPropertyStack()[0].typeName
        if stored != spec.typeName:
            _retype(layer, spec, stored, points)


def _retype(
    layer: Sdf.Layer, spec: Sdf.AttributeSpec, kind: Sdf.ValueTypeName, values: Usd.Attribute
) -> None:
    times, has_default = layer.ListTimeSamplesForPath(spec.path), spec.HasDefaultValue()
    owner = spec.owner
    owner.RemoveProperty(spec)
    spec = Sdf.AttributeSpec(owner, values.GetName(), kind)
    if has_default:
        spec.default = values.Get()
    for time in times:
        layer.SetTimeSample(spec.path, time, values.Get(time))


def _restore_cleared_targets(stage: Usd.Stage, layer: Sdf.Layer) -> None:
    """Clear relationships that are cleared in the stage: flattening forgets it.

    A mesh without a skeleton of its own would be bound to that of a prim above.
    """
    for prim in stage.Traverse():
        for relationship in prim.GetAuthoredRelationships():
            if not relationship.HasAuthoredTargets() or relationship.GetTargets():
                continue
            spec = layer.GetRelationshipAtPath(relationship.GetPath())
            if spec is None:
                owner = layer.GetPrimAtPath(prim.GetPath())
                spec = Sdf.RelationshipSpec(owner, relationship.GetName(), relationship.IsCustom())
            spec.targetPathList.ClearEditsAndMakeExplicit()


def _prims(parent: Sdf.PrimSpec) -> Iterator[Sdf.PrimSpec]:
    for prim in parent.nameChildren:
        yield prim
        yield from _prims(prim)


def _prototypes(layer: Sdf.Layer) -> set[Sdf.Path]:
    instancers = (prim for prim in _prims(layer.pseudoRoot) if prim.typeName == "PointInstancer")
    found: set[Sdf.Path] = set()
    for prim in instancers:
        relationship = prim.relationships.get(UsdGeom.Tokens.prototypes)
        if relationship is not None:
            found.update(relationship.targetPathList.GetAddedOrExplicitItems())
    return found


def _related(path: Sdf.Path, other: Sdf.Path) -> bool:
    return bool(path.HasPrefix(other) or other.HasPrefix(path))
