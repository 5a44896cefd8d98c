"""Rigs (UsdSkel): what joints and blend shapes make of the points of a mesh, and when."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, UsdSkel, Vt

from meshmark.arrays import FloatArray
from meshmark.errors import InputError
from meshmark.usd.blend_shapes import BlendShapes
from meshmark.usd.geometry import finite, local_to_world, time_code, transformed
from meshmark.usd.influences import Influences

# Times this close are the same: layer offsets round.
SAME_TIME = 1e-9
INSTANCES_TOO = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)


@dataclass(frozen=True, eq=False)
class Rig:
    """What deforms a mesh prim: the joints of a skeleton, blend shapes, or both.

    Parameters
    ----------
    bone : Usd.Prim
        The skeleton, in whose space the joints move.
    skeleton : UsdSkel.SkeletonQuery
        Poses the joints.
    skinning : UsdSkel.SkinningQuery
        Binds the prim to them.
    influences : Influences or None
        Of the joints, in place of those that the prim has.
    other_shapes : BlendShapes or None
        In place of those that the prim has.
    """

    bone: Usd.Prim
    skeleton: UsdSkel.SkeletonQuery
    skinning: UsdSkel.SkinningQuery
    influences: Influences | None = None
    other_shapes: BlendShapes | None = None

    @property
    def prim(self) -> Usd.Prim:
        """The mesh prim."""
        return self.skinning.GetPrim()

    @property
    def moved_by_joints(self) -> bool:
        """Whether joints move it, not blend shapes alone."""
        return bool(self.skinning.HasJointInfluences())

    @cached_property
    def shapes(self) -> BlendShapes | None:
        """Its blend shapes, if it has any."""
        if self.other_shapes is not None or not self.skinning.HasBlendShapes():
            return self.other_shapes
        return BlendShapes.of(self.skinning, self.skeleton.GetAnimQuery() or None)

    @cached_property
    def times(self) -> FloatArray:
        """The times, sorted, at which anything that moves its points is sampled."""
        times = np.unique(np.fromiter(self._times(), dtype=np.float64))
        close = np.diff(times) <= SAME_TIME * np.maximum(1.0, np.abs(times[1:]))
        return times[np.concatenate([[True], ~close])] if times.size else times

    def _times(self) -> Iterator[float]:
        yield from UsdGeom.Mesh(self.prim).GetPointsAttr().GetTimeSamples()
        for prim in (self.prim, self.bone):
            for above in prim.GetPath().GetPrefixes():
                place = UsdGeom.Xformable(self.prim.GetStage().GetPrimAtPath(above))
                yield from place.GetTimeSamples() if place else ()
        animation = self.skeleton.GetAnimQuery()
        if animation and self.shapes is not None:
            yield from animation.GetBlendShapeWeightTimeSamples()
        if self.moved_by_joints:
            yield from animation.GetJointTransformTimeSamples() if animation else ()
            for attribute in self._influences():
                yield from attribute.GetTimeSamples()

    def _influences(self) -> list[Usd.Attribute]:
        found = (
            self.skinning.GetJointIndicesPrimvar().GetAttr(),
            self.skinning.GetJointWeightsPrimvar().GetAttr(),
            self.skinning.GetGeomBindTransformAttr(),
        )
        return [attribute for attribute in found if attribute]

    def pose(self, rest: NDArray[np.floating], time: float) -> FloatArray:
        """Deform points (N, 3) of the rest pose, in the prim's own space before and after.

        usd-core computes it, in single precision.

        Raises
        ------
        InputError
            If the rig does not fit the points, or they cannot be in the prim's space; the
            caller adds where.
        """
        posed = self.deformed(rest, time)
        return transformed(posed, self.to_prim(time)) if self.moved_by_joints else posed

    def deformed(self, rest: NDArray[np.floating], time: float) -> FloatArray:
        """Deform points (N, 3): into the skeleton's space, if joints move them.

        Raises
        ------
        InputError
            If the joints do not fit each other, or the points; the caller adds where.
        """
        points = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(rest, dtype=np.float32))
        code = time_code(time)
        if self.shapes is not None:
            points = self.shapes.blended(points, code)
        if self.moved_by_joints:
            joints = self.skeleton.ComputeSkinningTransforms(code)
            if not joints or not self._skin(joints, points, code):
                raise InputError("the joints do not fit each other, or the mesh")
        return np.asarray(points, dtype=np.float64)

    def _skin(self, joints: Vt.Matrix4dArray, points: Vt.Vec3fArray, code: Usd.TimeCode) -> bool:
        if self.influences is not None:
            return self.influences.skin(self.skinning, joints, points, code)
        return bool(self.skinning.ComputeSkinnedPoints(joints, points, code))

    def to_prim(self, time: float) -> FloatArray:
        """Return the matrix (4, 4) from the skeleton's space to the prim's, for row vectors.

        In a prim that is scaled to nothing, nothing has an extent.

        Raises
        ------
        InputError
            If a transform is not finite.
        """
        bone, own = (self._transform(prim, time) for prim in (self.bone, self.prim))
        try:
            return bone @ np.linalg.inv(own)
        except np.linalg.LinAlgError:
            return bone @ np.linalg.pinv(own)

    def _transform(self, prim: Usd.Prim, time: float) -> FloatArray:
        """Return the matrix (4, 4) from a prim's space to that of what is above both prims.

        Whatever scales both, be it to nothing, is left aside.
        """
        both = self.prim.GetPath().GetCommonPrefix(self.bone.GetPath())
        cache = UsdGeom.XformCache(time_code(time))
        above = self.prim.GetStage().GetPrimAtPath(both)
        if any(cache.ComputeRelativeTransform(each, above)[1] for each in (self.prim, self.bone)):
            return local_to_world(prim, time)
        matrix = np.array(cache.ComputeRelativeTransform(prim, above)[0], dtype=np.float64)
        return finite(matrix)


def rigs_below(root: Usd.Prim) -> dict[str, Rig]:
    """Map the path of every mesh that a skeleton below a SkelRoot deforms to its rig."""
    cache, skel_root = UsdSkel.Cache(), UsdSkel.Root(root)
    cache.Populate(skel_root, INSTANCES_TOO)
    found: dict[str, Rig] = {}
    for binding in cache.ComputeSkelBindings(skel_root, INSTANCES_TOO):
        bone = binding.GetSkeleton()
        # Of what is inside an instance, the query knows the prototype only.
        skeleton = cache.GetSkelQuery(bone)
        for skinning in binding.GetSkinningTargets():
            prim = skinning.GetPrim()
            if skeleton and prim.IsA(UsdGeom.Mesh) and _deforms(skinning):
                found[str(prim.GetPath())] = Rig(bone.GetPrim(), skeleton, skinning)
    return found


def skel_root(prim: Usd.Prim) -> Usd.Prim | None:
    """Return the outermost SkelRoot around a prim: nothing is skinned outside of one."""
    found = None
    while prim:
        found = prim if prim.IsA(UsdSkel.Root) else found
        prim = prim.GetParent()
    return found


def _deforms(skinning: UsdSkel.SkinningQuery) -> bool:
    return bool(skinning.HasJointInfluences() or skinning.HasBlendShapes())
