"""Specs of an override layer: of meshes, also inside variants, and classes for instances."""

from __future__ import annotations

from pxr import Sdf, Usd

from meshmark.usd.instances import Classes

NO_CLASSES = Classes()


def author_classes(layer: Sdf.Layer, classes: Classes, stage: Usd.Stage) -> None:
    """Give a layer empty classes, which instances inherit before whatever else they inherit."""
    if not classes.of:
        return
    root = Sdf.CreatePrimInLayer(layer, classes.root)
    root.specifier, root.hidden = Sdf.SpecifierClass, True
    for path in sorted(classes.of.values()):
        own = Sdf.CreatePrimInLayer(layer, path.StripAllVariantSelections())
        own.specifier = Sdf.SpecifierClass
    for instance, path in classes.links.items():
        over(layer, instance, stage, classes).inheritPathList.prependedItems = [path]


def over(
    layer: Sdf.Layer, place: Sdf.Path, stage: Usd.Stage, classes: Classes = NO_CLASSES
) -> Sdf.PrimSpec:
    """Make the spec of a mesh in a layer, and keep the order of the sets of variants around it.

    Of several sets the first is the strongest; whoever adds to one would put it first.
    """
    spec = Sdf.CreatePrimInLayer(layer, place)
    for prefix in place.GetPrefixes():
        if not prefix.IsPrimVariantSelectionPath():
            continue
        owner = layer.GetPrimAtPath(prefix.GetParentPath())
        path, around = prefix.StripAllVariantSelections(), _sets_around(prefix.GetParentPath())
        names = classes.sets.get(path) or stage.GetPrimAtPath(path).GetVariantSets().GetNames()
        owner.variantSetNameList.prependedItems = [each for each in names if each not in around]
    return spec


def _sets_around(path: Sdf.Path) -> set[str]:
    """Name the sets of the same prim whose variants a path ends in."""
    found: set[str] = set()
    while path.IsPrimVariantSelectionPath():
        found.add(path.GetVariantSelection()[0])
        path = path.GetParentPath()
    return found
