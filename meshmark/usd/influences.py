"""Influences of joints: which of them move each point of a mesh, and by how much."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.charts import SlidPoints
from meshmark.usd.layers import StreamedLayer

INDICES, WEIGHTS = "primvars:skel:jointIndices", "primvars:skel:jointWeights"
# Weights this near to each other differ by the rounding of float32.
SAME = 1e-7


@dataclass(frozen=True, eq=False)
class Influences:
    """What moves each point: the same number of joints, in the order of the mesh's binding.

    Parameters
    ----------
    indices : (N, n) int
        Joints.
    weights : (N, n) float64
        By how much each moves the point.
    """

    indices: IntArray
    weights: FloatArray

    @classmethod
    def of(cls, skinning: UsdSkel.SkinningQuery, n_points: int) -> Influences | None:
        """Read those of a mesh; None where its points do not have their own, at all times alike."""
        if not skinning.HasJointInfluences() or skinning.IsRigidlyDeformed():
            return None
        primvars = skinning.GetJointIndicesPrimvar(), skinning.GetJointWeightsPrimvar()
        if any(each.IsIndexed() or each.GetTimeSamples() for each in primvars):
            return None
        found = skinning.ComputeJointInfluences()
        n = skinning.GetNumInfluencesPerComponent()
        if not found or any(len(each) != n * n_points for each in found):
            return None
        indices, weights = (np.asarray(each).reshape(n_points, n) for each in found)
        fit = np.all(np.isfinite(weights)) and indices.min(initial=0) >= 0
        return cls(indices.astype(np.int64), weights.astype(np.float64)) if fit else None

    def skin(
        self,
        skinning: UsdSkel.SkinningQuery,
        joints: Vt.Matrix4dArray,
        points: Vt.Vec3fArray,
        code: Usd.TimeCode,
    ) -> bool:
        """Move points in place, as the mesh's own query does with its own; tell whether they fit.

        usd-core computes it, in single precision.
        """
        mapper = skinning.GetJointMapper()
        return bool(
            UsdSkel.SkinPoints(
                skinning.GetSkinningMethod(),
                Gf.Matrix4d(skinning.GetGeomBindTransform(code)),
                mapper.RemapTransforms(joints) if mapper else joints,
                self._stored_indices,
                self._stored_weights,
                self.indices.shape[1],
                points,
            )
        )

    @property
    def _stored_indices(self) -> Vt.IntArray:
        return Vt.IntArray.FromNumpy(self.indices.astype(np.int32).ravel())

    @property
    def _stored_weights(self) -> Vt.FloatArray:
        return Vt.FloatArray.FromNumpy(self.weights.astype(np.float32).ravel())

    def followed(self, slid: SlidPoints) -> Influences:
        """Give points that slid the influences of their new places on the old surface.

        These are interpolated in the triangle there. The largest are kept, as many as there were
        before, and scaled to what all of them weigh. Points that coincide and move alike stay
        together: to them, the surface has no seams.
        """
        places = slid.places
        corners, n = slid.kept[places.corners], self.indices.shape[1]
        shares = self.weights[corners] * places.clamped[..., None]
        indices, weights = self.indices[slid.kept], self.weights[slid.kept]
        there = _largest(self.indices[corners].reshape(-1, 3 * n), shares.reshape(-1, 3 * n), n)
        here = _largest(indices[places.rows], weights[places.rows], n)
        changed = np.any(there[0] != here[0], axis=1)
        changed |= np.any(np.abs(there[1] - here[1]) > SAME, axis=1)
        indices[places.rows[changed]], weights[places.rows[changed]] = (x[changed] for x in there)
        return Influences(indices[slid.rows], weights[slid.rows])

    @property
    def columns(self) -> FloatArray:
        """What is equal for points that move alike, (N, 2 n)."""
        return np.column_stack([self.indices, self.weights])

    def equal(self, other: Influences) -> bool:
        """Tell whether others are the same, in the same order."""
        return np.array_equal(self.indices, other.indices) and np.array_equal(
            self.weights, other.weights
        )

    def author(self, target: StreamedLayer, over: Sdf.PrimSpec) -> None:
        """Write them for a mesh."""
        types = Sdf.ValueTypeNames
        for name, kind, value in (
            (INDICES, types.IntArray, self._stored_indices),
            (WEIGHTS, types.FloatArray, self._stored_weights),
        ):
            spec = Sdf.AttributeSpec(over, name, kind)
            spec.SetInfo("interpolation", UsdGeom.Tokens.vertex)
            spec.SetInfo("elementSize", self.indices.shape[1])
            target.set(spec, np.nan, value, 4 * self.indices.size)


def _largest(indices: IntArray, weights: FloatArray, n: int) -> tuple[IntArray, FloatArray]:
    """Add the weights (m, k) of equal joints, and keep the n largest sums of each row."""
    order = np.argsort(indices, axis=1, kind="stable")
    indices = np.take_along_axis(indices, order, axis=1)
    weights = np.take_along_axis(weights, order, axis=1)
    total = weights.sum(axis=1, keepdims=True)
    for column in range(1, indices.shape[1]):
        same = indices[:, column] == indices[:, column - 1]
        weights[same, column] += weights[same, column - 1]
        weights[same, column - 1] = 0.0
    order = np.argsort(-weights, axis=1, kind="stable")[:, :n]
    indices = np.take_along_axis(indices, order, axis=1)
    weights = np.take_along_axis(weights, order, axis=1)
    left = weights.sum(axis=1, keepdims=True)
    scale = np.divide(total, left, out=np.ones_like(left), where=left > 0)
    return np.where(weights != 0, indices, 0), weights * scale
