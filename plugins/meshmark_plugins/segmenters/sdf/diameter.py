"""Shape diameter: how thick the volume is below each face, measured with a cone of rays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_matrix

from meshmark.arrays import FloatArray, IntArray
from meshmark.extension.parameters import require_number, require_whole
from meshmark.mesh.checks import mesh_arrays
from meshmark.mesh.open3d_import import load_open3d
from meshmark.mesh.topology import face_adjacency
from meshmark_plugins.segmenters.sdf.dual import normals_and_areas, unit_corners

RING = 6
"""Rays in one ring of the cone; the pattern has this rotational symmetry."""

MIN_HITS = 3
"""Fewer hits than this say nothing about a diameter."""

FACES_AT_ONCE = 8192
"""Faces whose rays are cast together: they and what they hit stay in the processor's cache."""

LIFT = 2e-5
"""How far a ray starts below its face, as a share of sqrt(area): float32 would hit the face."""


def shape_diameter(
    V: ArrayLike, F: ArrayLike, *, cone_angle: float = 120.0, rays: int = 25
) -> FloatArray:
    """Measure the shape diameter function of every face.

    Rays leave the face's centroid inside a cone about the inward normal. Lengths farther than
    one standard deviation from their median are dropped; the rest are averaged with weights
    inverse to the angle from the axis [1]_.

    Parameters
    ----------
    V : (N, 3) array_like of float
        Vertex positions.
    F : (F, 3) array_like of int
        Triangles, consistently oriented. A mesh that is inside out as a whole is turned.
    cone_angle : float
        Opening angle of the cone in degrees, above 0 and below 180.
    rays : int
        Rays of a face, rounded up to one along the axis and whole rings of six.

    Returns
    -------
    (F,) float64
        Diameter in the unit of `V`. A face without a measure of its own (its rays miss, or it
        has no area) takes its neighbours' value; NaN where a whole component has none.

    Raises
    ------
    UsageError
        If a parameter is out of range.
    InputError
        If the arrays are not those of a mesh.

    Notes
    -----
    The rays are laid out in the face's own frame, found from its shape and not from the order
    of its corners, so that turning, scaling, moving or re-ordering the mesh changes nothing
    beyond rounding.

    References
    ----------
    .. [1] L. Shapira, A. Shamir, D. Cohen-Or, "Consistent mesh partitioning and skeletonisation
       using the shape diameter function", The Visual Computer 24 (2008).
       doi:10.1007/s00371-007-0197-5
    """
    points, faces = mesh_arrays(V, F)
    require_number("shape_diameter", "cone_angle", cone_angle, 0.0, 180.0)
    require_whole("shape_diameter", "rays", rays, 1, 10_000)
    corners, scale = unit_corners(points, faces)
    normal, area = normals_and_areas(corners)
    outward = -1.0 if _signed_volume(corners) < -1e-6 else 1.0
    angle, azimuth = cone(cone_angle, rays)
    weights, min_hits = _weights(angle), min(MIN_HITS, len(angle))
    scene = _scene(corners)
    diameter = np.empty(len(faces))
    for start in range(0, len(faces), FACES_AT_ONCE):
        some = slice(start, start + FACES_AT_ONCE)
        lines = _rays(corners[some], -outward * normal[some], angle, azimuth)
        diameter[some] = _weighted_mean(_lengths(scene, lines, outward), weights, min_hits)
    diameter[area <= 0.0] = np.nan
    return fill_from_neighbours(scale * diameter, faces)


def cone(cone_angle: float, rays: int) -> tuple[FloatArray, FloatArray]:
    """Lay out rays over a cone, evenly in solid angle and with six-fold symmetry.

    Parameters
    ----------
    cone_angle : float
        Opening angle in degrees.
    rays : int
        Wanted number; rounded up to 1 + 6 m.

    Returns
    -------
    angle, azimuth : (1 + 6 m,) float64
        Radians from the axis and about it.
    """
    rings = -(-(rays - 1) // RING)
    half = np.radians(cone_angle) / 2.0
    # The axis ray stands for 1 of 1 + 6 m equal shares of the spherical cap, each ring for 6.
    share = (1.0 + RING * (np.arange(rings) + 0.5)) / (1.0 + RING * rings)
    ring_angle = np.arccos(1.0 - share * (1.0 - np.cos(half)))
    golden = (np.sqrt(5.0) - 1.0) / 2.0
    turn = (np.arange(rings) * golden)[:, None] + np.arange(RING)
    angle = np.concatenate([[0.0], np.repeat(ring_angle, RING)])
    azimuth = np.concatenate([[0.0], (2.0 * np.pi / RING * turn).reshape(-1)])
    return angle, azimuth


def fill_from_neighbours(x: FloatArray, F: IntArray) -> FloatArray:
    """Replace NaN by the mean of the neighbouring faces' values, ring by ring.

    Parameters
    ----------
    x : (F,) float64
        One number a face.
    F : (F, 3) int
        Triangles.

    Returns
    -------
    (F,) float64
        The same numbers without NaN, but in components that hold nothing else.
    """
    filled = x.copy()
    missing = np.isnan(filled)
    if not missing.any():
        return filled
    pairs, _ = face_adjacency(F)
    i, j = np.concatenate([pairs, pairs[:, ::-1]]).T
    neighbours = csr_matrix((np.ones(len(i)), (i, j)), shape=(len(F), len(F)))
    while missing.any():
        total = neighbours @ np.where(missing, 0.0, filled)
        count = neighbours @ (~missing).astype(np.float64)
        reached = missing & (count > 0)
        if not reached.any():
            break
        filled[reached] = total[reached] / count[reached]
        missing &= ~reached
    return filled


def _signed_volume(corners: FloatArray) -> float:
    """Volume between the surface and the origin, positive if normals point outwards."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def _rays(
    corners: FloatArray, axis: FloatArray, angle: FloatArray, azimuth: FloatArray
) -> NDArray[np.float32]:
    """Turn the cone pattern into each face's frame: origins and directions, (F, R, 6)."""
    tangent = _tangent(corners, axis)
    frame = np.stack([axis, tangent, np.cross(axis, tangent)], axis=1)
    sine = np.sin(angle)
    pattern = np.stack([np.cos(angle), sine * np.cos(azimuth), sine * np.sin(azimuth)], axis=1)
    rays = np.empty((len(corners), len(angle), 6), dtype=np.float32)
    rays[..., 3:] = pattern.astype(np.float32) @ frame.astype(np.float32)
    rays[..., :3] = corners.mean(axis=1)[:, None].astype(np.float32) + LIFT * rays[..., 3:]
    return rays


def _tangent(corners: FloatArray, axis: FloatArray) -> FloatArray:
    """Find a direction in each face that does not depend on the order of its corners.

    In the plane of the face, edges are complex numbers z; arg(sum z^6) / 6 is defined up to
    sixths of a turn, which the six-fold symmetry of the cone does not feel. Unlike the longest
    edge it does not jump when noise makes another edge the longest.
    """
    E = np.roll(corners, -1, axis=1) - corners
    first = np.argmax(np.einsum("ijk,ijk->ij", E, E), axis=1)
    u = E[np.arange(len(E)), first]
    norm = np.linalg.norm(u, axis=1, keepdims=True)
    u = u / np.where(norm > 0.0, norm, 1.0)
    v = np.cross(axis, u)
    z = np.einsum("ijk,ik->ij", E, u) + 1j * np.einsum("ijk,ik->ij", E, v)
    theta = np.angle(((z / np.where(norm > 0.0, norm, 1.0)) ** RING).sum(axis=1)) / RING
    return np.cos(theta)[:, None] * u + np.sin(theta)[:, None] * v


def _scene(corners: FloatArray) -> Any:
    """Prepare triangles (F, 3, 3) for rays."""
    o3d = load_open3d()
    scene = o3d.t.geometry.RaycastingScene()
    soup = np.arange(3 * len(corners), dtype=np.uint32).reshape(-1, 3)
    points = corners.reshape(-1, 3).astype(np.float32)
    scene.add_triangles(o3d.core.Tensor(points), o3d.core.Tensor(soup))
    return scene


def _lengths(scene: Any, rays: NDArray[np.float32], outward: float) -> FloatArray:
    """Length of each ray to where it leaves the volume, (F, R) float64; NaN for a miss.

    `outward` is 1 if the corners run counter-clockwise as seen from outside, else -1.
    """
    hits = scene.cast_rays(load_open3d().core.Tensor(rays))
    length: FloatArray = hits["t_hit"].numpy().astype(np.float64) + LIFT
    # Inner faces are met from outside; a true exit leaves through the front of its face.
    slope = np.einsum("ijk,ijk->ij", hits["primitive_normals"].numpy(), rays[..., 3:])
    length[~np.isfinite(length) | (outward * slope <= 0.0)] = np.nan
    return length


def _weights(angle: FloatArray) -> FloatArray:
    """Inverse of the angle from the axis; the axis ray counts as half the innermost ring."""
    inner = angle[1] / 2.0 if len(angle) > 1 else 1.0
    return 1.0 / np.maximum(angle, inner)


def _weighted_mean(length: FloatArray, weight: FloatArray, min_hits: int) -> FloatArray:
    """Average each row's lengths within one standard deviation of their median; NaN if too few."""
    hit = ~np.isnan(length)
    count = hit.sum(axis=1)
    order = np.sort(length, axis=1)
    rows = np.arange(len(length))
    last = np.maximum(count - 1, 0)
    median = (order[rows, last // 2] + order[rows, (last + 1) // 2]) / 2.0
    deviation = np.where(hit, length - median[:, None], 0.0)
    mean = deviation.sum(axis=1) / np.maximum(count, 1)
    variance = (deviation**2).sum(axis=1) / np.maximum(count, 1) - mean**2
    near = np.abs(deviation) <= np.sqrt(np.maximum(variance, 0.0))[:, None] * (1.0 + 1e-9)
    kept = np.where(hit & near, weight, 0.0)
    total = kept.sum(axis=1)
    value = np.where(hit, length, 0.0)
    average = (kept * value).sum(axis=1) / np.where(total > 0.0, total, 1.0)
    return np.where((count >= min_hits) & (total > 0.0), average, np.nan)
