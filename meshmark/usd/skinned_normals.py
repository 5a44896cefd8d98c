"""Normals of a rigged mesh, as its rig turns them."""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdGeom, UsdSkel, Vt

from meshmark.arrays import FloatArray, IntArray
from meshmark.usd.blend_shapes import BlendShapes
from meshmark.usd.geometry import Float32Array, polygons, time_code
from meshmark.usd.skinning import Rig

BY_POINT = (UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying)


def skinned_normals(
    rig: Rig, time: float, attribute: Usd.Attribute | None = None
) -> Float32Array | None:
    """Return the normals of points or corners at a time, (n, 3), in the prim's own space.

    Joints and blend shapes turn them as in usd-core's own baking.

    Parameters
    ----------
    attribute : Usd.Attribute, optional
        What holds them: `normals` where not given, or a primvar.

    Returns
    -------
    (n, 3) float32 or None
        None where there are none for points or corners, or they do not fit these.
    """
    mesh, code = UsdGeom.Mesh(rig.prim), time_code(time)
    primvar = UsdGeom.Primvar(attribute) if attribute else None
    if not primvar:
        value, interpolation = mesh.GetNormalsAttr().Get(code), mesh.GetNormalsInterpolation()
    else:
        value, interpolation = primvar.ComputeFlattened(code), primvar.GetInterpolation()
    by_point = interpolation in BY_POINT
    by_corner = interpolation == UsdGeom.Tokens.faceVarying
    if not isinstance(value, Vt.Vec3fArray) or not (by_point or by_corner):
        return None
    normals = np.array(value)
    if rig.shapes is not None and by_point:
        normals = _blended(rig.shapes, normals, code)
    if not rig.moved_by_joints:
        return normals
    n_points = len(mesh.GetPointsAttr().Get(code))
    vertices = np.arange(n_points) if by_point else polygons(mesh, code)[1]
    return _skinned(rig, normals, vertices, n_points, time)


def _blended(shapes: BlendShapes, normals: Float32Array, code: Usd.TimeCode) -> Float32Array:
    found = shapes.sub_shape_weights(code)
    if found is None:
        return normals
    blended, offsets = normals.copy(), shapes.normal_offsets
    for weight, shape, sub_shape in zip(*found, strict=True):
        vertices = shapes.shapes[shape].vertices
        rows = vertices if vertices.size else np.arange(len(blended))
        fit = rows.size > 0 and 0 <= rows.min() <= rows.max() < len(blended)
        if fit and len(offsets[sub_shape]) == len(rows):
            np.add.at(blended, rows, np.float32(weight) * offsets[sub_shape])
    lengths = np.linalg.norm(blended, axis=1, keepdims=True)
    return (blended / np.where(lengths > 0, lengths, 1)).astype(np.float32)


def _skinned(
    rig: Rig, normals: Float32Array, vertices: IntArray, n_points: int, time: float
) -> Float32Array | None:
    """Turn normals (n, 3) of the given vertices (n,) by the joints."""
    code, skinning = time_code(time), rig.skinning
    joints = rig.skeleton.ComputeSkinningTransforms(code)
    mapper = skinning.GetJointMapper()
    if mapper:
        joints = mapper.RemapTransforms(joints)
    n = skinning.GetNumInfluencesPerComponent()
    influences = skinning.ComputeVaryingJointInfluences(n_points, code)
    indices, weights = (np.asarray(each).reshape(-1, n) for each in influences)
    skinned = Vt.Vec3fArray.FromNumpy(normals)
    if len(normals) != len(vertices) or not UsdSkel.SkinNormals(
        skinning.GetSkinningMethod(),
        _turning(np.array(skinning.GetGeomBindTransform(code))[None])[0],
        _turning(np.array(joints)),
        Vt.IntArray.FromNumpy(indices[vertices].ravel()),
        Vt.FloatArray.FromNumpy(weights[vertices].ravel()),
        n,
        skinned,
    ):
        return None
    to_prim = rig.to_prim(time)[:3, :3]
    placed = np.asarray(skinned, dtype=np.float64) @ np.linalg.pinv(to_prim).T
    return placed.astype(np.float32)


def _turning(matrices: FloatArray) -> Vt.Matrix3dArray:
    """Return what matrices (n, 4, 4) do to normals; singular ones turn them into nothing."""
    linear = np.linalg.pinv(matrices[:, :3, :3]).transpose(0, 2, 1)
    return Vt.Matrix3dArray.FromNumpy(np.ascontiguousarray(linear))
