"""Which prims of a stage are meshes to read, and what must be said about each."""

from __future__ import annotations

from pxr import Usd, UsdGeom, UsdSkel

INSTANCED = "inside an instance: cannot be marked in place, only in a flattened deliverable"
SKINNED = "skinned: rest pose points"


def mesh_prims(stage: Usd.Stage) -> list[Usd.Prim]:
    """List the mesh prims of a stage in its own order, those inside instances included.

    Active, loaded and defined prims only: classes, pure overs and deactivated prims are no part
    of what the stage shows. Visibility is not asked: it may be animated.
    """
    inside_instances_too = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
    prims = Usd.PrimRange(stage.GetPseudoRoot(), inside_instances_too)
    return [prim for prim in prims if prim.IsA(UsdGeom.Mesh)]


def is_guide(prim: Usd.Prim) -> bool:
    """Tell whether a prim only helps those who work on the stage (purpose `guide`)."""
    return bool(UsdGeom.Imageable(prim).ComputePurpose() == UsdGeom.Tokens.guide)


def is_skinned(prim: Usd.Prim) -> bool:
    """Tell whether a skeleton deforms the mesh."""
    binding = UsdSkel.BindingAPI(prim)
    influenced = binding.GetJointIndicesPrimvar().HasAuthoredValue()
    return bool(influenced and binding.GetInheritedSkeleton())


def notes(prim: Usd.Prim) -> tuple[str, ...]:
    """Say what a person should know about how a mesh prim is read."""
    said = {INSTANCED: prim.IsInstanceProxy(), SKINNED: is_skinned(prim)}
    return tuple(note for note, applies in said.items() if applies)
