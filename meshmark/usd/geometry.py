"""A mesh prim's arrays at one time, as numpy sees them."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, Vt

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import InputError
from meshmark.mesh.checks import require_measurable
from meshmark.mesh.topology import Topology

# When a rigged mesh is in its rest pose: before all time.
REST = -np.inf

Float32Array = NDArray[np.float32]

# What points may be stored as; the role of a type (point, vector, colour) does not matter.
POINT_ARRAYS = (Vt.Vec3hArray, Vt.Vec3fArray, Vt.Vec3dArray)
IDENTITY = np.eye(4)
INTEGER_ARRAYS = (Vt.IntArray, Vt.Int64Array, Vt.UIntArray, Vt.UInt64Array, Vt.UCharArray)


def time_code(time: float) -> Usd.TimeCode:
    """Return the USD time of a frame: NaN, no time at all, and `REST` read the first there is."""
    return Usd.TimeCode(time) if np.isfinite(time) else Usd.TimeCode.EarliestTime()


def sample_times(prim: Usd.Prim) -> FloatArray:
    """Return the times the points are sampled at, or a single NaN if they are not."""
    times = UsdGeom.Mesh(prim).GetPointsAttr().GetTimeSamples()
    return np.array(times if times else [np.nan], dtype=np.float64)


def local_points(prim: Usd.Prim, time: float) -> NDArray[np.floating]:
    """View the points in the prim's own space and type, (N, 3), without a copy.

    Raises
    ------
    InputError
        If there are none, they are no points, or one is not finite; the caller adds where.
    """
    value = UsdGeom.Mesh(prim).GetPointsAttr().Get(time_code(time))
    if value is not None and not isinstance(value, POINT_ARRAYS):
        raise InputError(
            f"points of type {type(value).__name__}; they must be an array of half3, float3 or "
            "double3"
        )
    if not value:
        raise InputError("the mesh has no points")
    points: NDArray[np.floating] = np.asarray(value)
    require_measurable(points)
    return points


def number_of_points(prim: Usd.Prim, time: float) -> int:
    """Count the points without looking at them."""
    return len(UsdGeom.Mesh(prim).GetPointsAttr().Get(time_code(time)))


def local_to_world(prim: Usd.Prim, time: float) -> FloatArray:
    """Return the matrix (4, 4) from the prim's own space to world space, for row vectors.

    Raises
    ------
    InputError
        If it is not finite; the caller adds where.
    """
    cache = UsdGeom.XformCache(time_code(time))
    return finite(np.array(cache.GetLocalToWorldTransform(prim), dtype=np.float64))


def finite(matrix: FloatArray) -> FloatArray:
    """Return a transform as it is.

    Raises
    ------
    InputError
        If it is not finite; the caller adds where.
    """
    if not np.isfinite(matrix).all():
        raise InputError("its transform to world space is not finite")
    return matrix


def world_points(points: NDArray[np.floating], matrix: FloatArray) -> FloatArray:
    """Take local points (N, 3) to world space.

    Raises
    ------
    InputError
        If one ends up too far away to compute with; the caller adds where.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        world = transformed(points, matrix)
    require_measurable(world)
    return world


def transformed(points: NDArray[np.floating], matrix: FloatArray) -> FloatArray:
    """Apply a matrix (4, 4) to row vectors (N, 3).

    Column by column: what a matrix product rounds to depends on the threads it is given.
    """
    P = points.astype(np.float64)
    if np.array_equal(matrix, IDENTITY):
        # As most caches have it. No negative zeros either way.
        return P + 0.0
    return _product(P, matrix) + matrix[3, :3]


def turned(vectors: FloatArray, matrix: FloatArray) -> FloatArray:
    """Apply the linear part of a matrix (4, 4) to row vectors (N, 3)."""
    return _product(vectors, matrix)


def _product(vectors: FloatArray, matrix: FloatArray) -> FloatArray:
    x, y, z = np.ascontiguousarray(vectors.T)
    columns = [x * a + y * b + z * c for a, b, c in matrix[:3, :3].T]
    return np.stack(columns, axis=1)


def read_topology(prim: Usd.Prim, time: float, n_points: int) -> Topology:
    """Read the polygons, wound so that their normals point outward in world space.

    A prim may say that its faces are left-handed, and a mirroring transform turns any face
    inside out: one of the two, not both, calls for the corners to be listed backwards.

    Raises
    ------
    InputError
        If there are no faces, or they do not fit the points; the caller adds where.
    """
    mesh = UsdGeom.Mesh(prim)
    code = time_code(time)
    topology = Topology.fit(*polygons(mesh, code), n_points)
    if not inside_out(prim, time):
        return topology
    return replace(topology, indices=backwards(topology.counts, topology.indices))


def polygons(mesh: UsdGeom.Mesh, code: Usd.TimeCode) -> tuple[IntArray, IntArray]:
    """Read how many corners each face has, (P,), and the vertices at them, (sum of counts,).

    Raises
    ------
    InputError
        If they do not fit each other; the caller adds where.
    """
    counts = integers(mesh.GetFaceVertexCountsAttr(), code)
    # Integers would turn round: four times 2**62 is nothing at all.
    size = int(counts.sum(dtype=np.float64))
    return counts, integers(mesh.GetFaceVertexIndicesAttr(), code, size=size)


def inside_out(prim: Usd.Prim, time: float) -> bool:
    """Tell whether the faces, as their corners are listed, face inward in world space."""
    left_handed = UsdGeom.Mesh(prim).GetOrientationAttr().Get(time_code(time))
    # Not the determinant itself, which may overflow.
    mirrored = np.linalg.slogdet(local_to_world(prim, time)[:3, :3]).sign < 0
    return bool((left_handed == UsdGeom.Tokens.leftHanded) != mirrored)


def faces_vary(prim: Usd.Prim) -> bool:
    """Tell whether the faces of a mesh may be others at other times."""
    mesh = UsdGeom.Mesh(prim)
    faces = (mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr())
    return any(attribute.ValueMightBeTimeVarying() for attribute in faces)


def shapes(prim: Usd.Prim, times: FloatArray) -> list[Hashable | None]:
    """Tell which frames have the same faces over as many points of the same type.

    Returns
    -------
    list
        For each time something that is equal for those; None where there is no mesh.
    """
    mesh = UsdGeom.Mesh(prim)
    sampled = faces_vary(prim)
    found: list[Hashable | None] = []
    known: dict[Hashable, Hashable | None] = {}
    for time in times.tolist():
        code = time_code(time)
        points = mesh.GetPointsAttr().Get(code)
        if not isinstance(points, POINT_ARRAYS):
            found.append(None)
            continue
        kind = (type(points), len(points))
        if sampled or kind not in known:
            known[kind] = _shape(kind, mesh, code)
        found.append(known[kind])
    return found


def connectivity_changes(prim: Usd.Prim, times: FloatArray) -> bool:
    """Tell whether a mesh has other faces, or another number of points, at some of its times."""
    return faces_vary(prim) and len({*shapes(prim, times)}) > 1


def _shape(kind: tuple[type, int], mesh: UsdGeom.Mesh, code: Usd.TimeCode) -> Hashable | None:
    try:
        return kind[0], Topology.fit(*polygons(mesh, code), kind[1]).digest()
    except InputError:
        return None


def integers(attribute: Usd.Attribute, code: Usd.TimeCode, size: int | None = None) -> IntArray:
    """Read an array of integers, (n,); none where the attribute has no value.

    Parameters
    ----------
    size : int, optional
        What n is to be. A damaged file may claim any, in a few bytes.

    Raises
    ------
    InputError
        If it is something else; the caller adds where.
    """
    value = attribute.Get(code)
    if value is None:
        # An attribute without a value is a mesh without faces: Topology says so.
        return np.zeros(0, dtype=np.int64)
    if not isinstance(value, INTEGER_ARRAYS):
        raise InputError(
            f"{attribute.GetName()} of type {type(value).__name__}; it must be an array of integers"
        )
    if size is not None and len(value) != size:
        raise InputError(f"{len(value)} {attribute.GetName()}, where {size} are expected")
    # Unsigned 64-bit numbers out of range become negative ones, which Topology refuses.
    return np.asarray(value).astype(np.int64)


def backwards(counts: IntArray, indices: IntArray) -> IntArray:
    """List each polygon's corners backwards, from the same first corner.

    Parameters
    ----------
    counts : (P,) int
        Corners of each polygon.
    indices : (sum(counts),) int
        Anything that is said of the corners, polygon after polygon.
    """
    start = np.repeat(np.cumsum(counts) - counts, counts)
    corner = np.arange(indices.size) - start
    return indices[start + (-corner) % np.repeat(counts, counts)]
