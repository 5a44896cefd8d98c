"""A rigged mesh prim as if it had never been rigged: baked points are not to be posed again."""

from __future__ import annotations

from pxr import Sdf, Usd, UsdGeom, UsdSkel

from meshmark.usd.layers import StreamedLayer
from meshmark.usd.skinned_normals import skinned_normals
from meshmark.usd.skinning import Rig

SKELETON = "skel:skeleton"
BINDING = "SkelBindingAPI"


def unbind(over: Sdf.PrimSpec, prim: Usd.Prim) -> None:
    """Take a prim from its skeleton: an explicit list without targets, as UsdSkel defines it.

    What else is bound to the skeleton stays. usd-core's own baking turns the whole SkelRoot into
    an Xform instead.
    """
    if not prim.HasAPI(UsdSkel.BindingAPI):
        schemas = Sdf.TokenListOp()
        schemas.prependedItems = [BINDING]
        over.SetInfo("apiSchemas", schemas)
    relationship = Sdf.RelationshipSpec(over, SKELETON, False, Sdf.VariabilityUniform)
    relationship.targetPathList.ClearEditsAndMakeExplicit()


def bake_normals(target: StreamedLayer, over: Sdf.PrimSpec, rig: Rig, time: float) -> None:
    """Write the normals of a prim, if it has any, as its rig turns them at a time."""
    attribute = UsdGeom.Mesh(rig.prim).GetNormalsAttr()
    normals = skinned_normals(rig, time) if attribute.HasAuthoredValue() else None
    if normals is None:
        return
    spec = over.attributes.get(attribute.GetName()) or Sdf.AttributeSpec(
        over, attribute.GetName(), attribute.GetTypeName()
    )
    target.set_vectors(spec, time, normals)
