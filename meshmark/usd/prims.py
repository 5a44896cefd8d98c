"""Which prims of a stage are meshes to read, and what must be said about each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from pxr import Usd, UsdGeom

from meshmark.usd.stamping import stamp_note

INVISIBLE = "invisible at its first time"


def mesh_prims(stage: Usd.Stage) -> list[Usd.Prim]:
    """List the mesh prims of a stage in its own order, those inside instances included.

    Active, loaded and defined prims only: classes, pure overs and deactivated prims are no part
    of what the stage shows. Visibility is not asked: it may be animated.
    """
    inside_instances_too = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
    prims = Usd.PrimRange(stage.GetPseudoRoot(), inside_instances_too)
    return [prim for prim in prims if prim.IsA(UsdGeom.Mesh)]


def hidden_prototypes(stage: Usd.Stage) -> list[Usd.Prim]:
    """List meshes that are shown by a point instancer only: not defined, or not active.

    They are not read, and stay in a flattened stage.
    """
    shown = {prim.GetPath() for prim in mesh_prims(stage)}
    instancers = (UsdGeom.PointInstancer(prim) for prim in stage.TraverseAll())
    targets = (each.GetPrototypesRel().GetTargets() for each in instancers if each)
    roots = (stage.GetPrimAtPath(path) for paths in targets for path in paths)
    below = (prim for root in roots if root for prim in Usd.PrimRange.AllPrims(root))
    found = {prim.GetPath(): prim for prim in below if prim.IsA(UsdGeom.Mesh)}
    return [prim for path, prim in found.items() if path not in shown]


def missing_layers(stage: Usd.Stage) -> list[tuple[str, str]]:
    """List the prims of which something could not be composed, and why."""
    said: dict[str, str] = {}
    for error in stage.GetCompositionErrors():
        said.setdefault(str(error.rootSite.path), " ".join(str(error).split()).rstrip("."))
    return list(said.items())


def not_looked_at(stage: Usd.Stage) -> tuple[str, ...]:
    """Count what a stage holds beside the meshes that `mesh_prims` lists, by kind."""
    found = Usd.PrimRange(
        stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)
    )
    counts = Counter(kind for prim in found if (kind := _other_kind(prim)) is not None)
    if not counts:
        return ()
    return (f"not looked at: {', '.join(f'{n} {kind}' for kind, n in sorted(counts.items()))}",)


def _other_kind(prim: Usd.Prim) -> str | None:
    shown = prim.IsActive() and prim.IsDefined() and not prim.IsAbstract()
    if prim.IsA(UsdGeom.Mesh):
        if shown:
            return None
        hidden = "class" if prim.IsAbstract() else "over" if prim.IsActive() else "deactivated"
        return f"Mesh ({hidden})"
    if shown and (prim.IsA(UsdGeom.Gprim) or prim.IsA(UsdGeom.PointInstancer)):
        return str(prim.GetTypeName())
    return None


def is_guide(prim: Usd.Prim) -> bool:
    """Tell whether a prim only helps those who work on the stage (purpose `guide`)."""
    return bool(UsdGeom.Imageable(prim).ComputePurpose() == UsdGeom.Tokens.guide)


def note_on_sharing(path: str, alike: Sequence[str]) -> str:
    """Say of a mesh inside an instance which of those that show the same points is marked."""
    if not alike:
        return "inside an instance, and posed there in its own way: marked by --deliver only"
    if alike[0] != path:
        return f"inside an instance: an override layer marks it as it marks {alike[0]}"
    others = f", and like it {len(alike) - 1} more" if len(alike) > 1 else ""
    return f"inside an instance: an override layer marks it{others}"


def notes(prim: Usd.Prim) -> tuple[str, ...]:
    """Say what a person should know about how a mesh prim is read."""
    image = UsdGeom.Imageable(prim)
    purpose = str(image.ComputePurpose())
    visibility = image.ComputeVisibility(Usd.TimeCode.EarliestTime())
    said = {
        f"purpose {purpose}": purpose != UsdGeom.Tokens.default_,
        INVISIBLE: visibility == UsdGeom.Tokens.invisible,
    }
    stamp = stamp_note(prim)
    return (*(note for note, applies in said.items() if applies), *([stamp] if stamp else []))
