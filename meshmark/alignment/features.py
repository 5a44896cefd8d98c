"""Rough placements of parts of a surface, by local features and random triples of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from meshmark.alignment.copy_frames import CopyFrame
from meshmark.alignment.pose_samples import PoseSamples
from meshmark.alignment.refinement import Placement
from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.closest_points import surface_samples
from meshmark.mesh.frame_range import spread
from meshmark.mesh.geometry import area_vectors, edge_length, face_areas, lengths, normalized
from meshmark.mesh.open3d_import import load_open3d

# Radii of normals' neighbourhoods, as shares of the original's diagonal.
RADIUS, MOST_NEIGHBOURS = 0.08, 150
# Fewest and most points with features, and points that score a placement.
POINTS, SCORED = (200, 2000), 120
# Features a point may be matched with, random triples drawn, and how many of them are scored.
CANDIDATES, TRIPLES, KEPT = 4, 120_000, 400
# How much the lengths in a triple may differ, and how long they must be, in diagonals.
STRETCH, SHORTEST = 0.12, 0.08
POSES = 8
# If the scale is unknown: shares of the original's area that the copy may be.
SHARES = (0.7, 0.5, 0.35, 0.2)
BEST = 6


@dataclass(frozen=True, eq=False)
class _Features:
    points: FloatArray
    normals: FloatArray
    values: FloatArray


def by_features(
    frame: CopyFrame, samples: PoseSamples, diagonal: float, area: float, edge: float
) -> Iterator[list[Placement]]:
    """List placements under which local features agree, the best first, for scale after scale.

    Parameters
    ----------
    frame : CopyFrame
    samples : PoseSamples
    diagonal, area, edge : float
        Of the original: of its bounding box, its area, and the median length of its edges.

    Notes
    -----
    Points are matched by fast point feature histograms [1]_. Triples of matches whose sides are
    alike give similarities, which are scored by distances.

    References
    ----------
    .. [1] R. B. Rusu, N. Blodow, M. Beetz, "Fast point feature histograms (FPFH) for 3D
       registration", ICRA 2009, doi:10.1109/ROBOT.2009.5152473.
    """
    rng = np.random.default_rng(0)
    poses = spread(len(samples.poses), POSES)
    radius = RADIUS * diagonal
    originals = [_features(samples.points[at], samples.normals[at], radius) for at in poses]
    own_area = float(face_areas(frame.points, frame.faces).sum())
    # Most edges of a mesh may be without length.
    own_edge = edge_length(frame.points, frame.faces) or np.inf
    scales = [edge / own_edge, 1.0, *(np.sqrt(share * area / own_area) for share in SHARES)]
    for scale in _distinct(scales):
        # As dense as those of the original: features depend on it.
        n = int(np.clip(len(samples.points[0]) * own_area * scale**2 / area, *POINTS))
        face, weights = surface_samples(frame.points, frame.faces, n, rng)
        P = np.einsum("ij,ijk->ik", weights, frame.points[frame.faces[face]])
        normals = normalized(area_vectors(frame.points, frame.faces[face]))
        found: list[tuple[float, Placement]] = []
        for mirror in (np.ones(3), np.array([-1.0, 1.0, 1.0])):
            # The normals of a mirror image point outwards, too.
            own = _features(scale * P * mirror, normals * mirror, radius)
            for at, original in zip(poses, originals, strict=True):
                for misfit, A in _ransac(own, original, samples, at, diagonal, rng):
                    A = np.column_stack([scale * A[:, :3] * mirror, A[:, 3]])
                    found.append((misfit, Placement(A, float(samples.poses[at]))))
        found.sort(key=lambda each: each[0])
        yield [placement for _, placement in found[: 2 * BEST]]


def _distinct(scales: list[float]) -> list[float]:
    """Leave out scales that are within reach of one before, or none."""
    kept: list[float] = []
    for scale in scales:
        if not 0.0 < scale < np.inf:
            continue
        if all(abs(np.log(scale / other)) > 0.5 * STRETCH for other in kept):
            kept.append(float(scale))
    return kept


def _features(points: FloatArray, normals: FloatArray, radius: float) -> _Features:
    o3d = load_open3d()
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    cloud.normals = o3d.utility.Vector3dVector(normals)
    found = o3d.pipelines.registration.compute_fpfh_feature(
        cloud, o3d.geometry.KDTreeSearchParamHybrid(radius, MOST_NEIGHBOURS)
    )
    return _Features(points, normals, np.asarray(found.data).T.copy())


def _ransac(
    own: _Features,
    original: _Features,
    samples: PoseSamples,
    at: int,
    diagonal: float,
    rng: np.random.Generator,
) -> list[tuple[float, FloatArray]]:
    """Find similarities [s R | t] under which triples of matches agree, with their misfits."""
    likely = _nearest(own.values, original.values)
    i = rng.integers(len(own.points), size=(TRIPLES, 3))
    j = likely[i, rng.integers(likely.shape[1], size=i.shape)]
    P, Q = own.points[i], original.points[j]
    sides = [lengths(P[:, a] - P[:, b]) for a, b in ((0, 1), (1, 2), (2, 0))]
    theirs = [lengths(Q[:, a] - Q[:, b]) for a, b in ((0, 1), (1, 2), (2, 0))]
    long = np.min(sides, axis=0) > SHORTEST * diagonal
    off = np.abs(np.log(np.maximum(theirs, 1e-300)) - np.log(np.maximum(sides, 1e-300)))
    worst = np.where(long, off.max(axis=0), np.inf)
    kept = np.argsort(worst, kind="stable")[: 10 * KEPT]
    kept = kept[worst[kept] < STRETCH]
    if kept.size == 0:
        return []
    A = _similarities(P[kept], Q[kept])
    R = A[:, :, :3] / np.cbrt(np.linalg.det(A[:, :, :3]))[:, None, None]
    turned = np.einsum("kij,kmj->kmi", R, own.normals[i[kept]])
    agreement = (turned * original.normals[j[kept]]).sum(axis=2).min(axis=1)
    A = A[np.argsort(-agreement, kind="stable")[:KEPT]]
    probe = own.points[spread(len(own.points), SCORED)]
    X = np.einsum("kij,mj->kmi", A[:, :, :3], probe) + A[:, None, :, 3]
    misfits = samples.misfits(X, at)
    best = np.argsort(misfits, kind="stable")[:BEST]
    return [(float(misfits[k]), A[k]) for k in best]


def _nearest(own: FloatArray, original: FloatArray) -> IntArray:
    """Find the likeliest matches of each feature, (n, CANDIDATES)."""
    squares = (original**2).sum(axis=1) - 2.0 * own @ original.T
    found: IntArray = np.argpartition(squares, CANDIDATES, axis=1)[:, :CANDIDATES]
    return found


def _similarities(P: FloatArray, Q: FloatArray) -> FloatArray:
    """Find the proper similarities that put triples P (k, 3, 3) on triples Q, (k, 3, 4)."""
    mean_p, mean_q = P.mean(axis=1, keepdims=True), Q.mean(axis=1, keepdims=True)
    p, q = P - mean_p, Q - mean_q
    U, D, Vt = np.linalg.svd(np.einsum("kni,knj->kij", q, p))
    D[:, 2], U[:, :, 2] = 0.0, U[:, :, 2] * np.sign(np.linalg.det(U @ Vt))[:, None]
    scale = D.sum(axis=1) / (p * p).sum(axis=(1, 2))
    A = scale[:, None, None] * (U @ Vt)
    return np.concatenate([A, (mean_q - mean_p @ A.transpose(0, 2, 1)).transpose(0, 2, 1)], axis=2)
