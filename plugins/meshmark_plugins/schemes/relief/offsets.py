"""How high each of a copy's vertices stands above its own vertex of the reference, exactly.

`residual.py` takes all that alignment and honest programs might explain out of the heights: too
much of it to tell single vertices from each other. Here the alignment is corrected by what it
leaves along the surface, where the relief moves nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from meshmark.arrays import FloatArray, IntArray
from meshmark.extension.informed import AlignedFrame
from meshmark.mesh.flip_guard import mean_edge_lengths
from meshmark.mesh.geometry import lengths, surface_box, vertex_normals

# Vertices that are looked at: so many at most, and no fewer than a fit is made of.
MOST_VERTICES, FEWEST = 9000, 64
# A vertex that lies within this share of the edges from one of the reference is that one.
NEXT = 0.1
ROUNDS = 3
# Offsets along the surface beyond so many standard deviations count for less.
CLIP = 3.0
# Median length of a vector whose two components are normal, of deviation 1.
RAYLEIGH_MEDIAN = float(np.sqrt(2.0 * np.log(2.0)))
# What no offset along the surface tells, like the size of a ball, is left as it was aligned.
RIDGE = 1e-4
# Frames are never trusted beyond this share of the typical height.
LEAST_NOISE = 1e-3
# Stands for no length at all, where one is divided by.
TINY = 1e-300


@dataclass(frozen=True, eq=False)
class Offsets:
    """Heights of vertices of a copy above their own vertices of the reference.

    Parameters
    ----------
    height : (V,) float64
        Of the vertices that `sampled` lists, in the unit of the points; NaN where there are none.
    deviation : float
        Standard deviation of their offsets along the surface, for each of two directions.
    """

    height: FloatArray
    deviation: float


def sampled(n_points: int) -> IntArray:
    """List the vertices that are looked at, (V,)."""
    return np.unique(np.linspace(0, n_points - 1, min(n_points, MOST_VERTICES)).astype(np.int64))


def offsets(view: AlignedFrame) -> Offsets:
    """Measure a frame's vertices above their own, or those that lie next to one of the reference.

    A program that puts vertices into another order, or cuts some away, leaves the others in place.
    """
    V, F = view.reference.points, view.reference.faces
    at = sampled(len(V))
    place = np.full(len(V), -1)
    place[at] = np.arange(len(at))
    vertices = _next_to(view.points, V, F, at) if view.vertices is None else view.vertices
    kept = np.flatnonzero(np.where(vertices >= 0, place[vertices], -1) >= 0)
    own = vertices[kept]
    if len(own) < FEWEST:
        return Offsets(np.full(len(at), np.nan), np.inf)
    diagonal, centre = surface_box(V, F)
    n = vertex_normals(V, F)[own]
    d, deviation = _aligned(
        view.points[kept] - V[own], n, (V[own] - centre) / diagonal, view.motion[own]
    )
    # Several vertices of the copy may be one of the reference, where it was welded.
    count = np.bincount(place[own], minlength=len(at))
    total = np.bincount(place[own], np.einsum("ij,ij->i", d, n), len(at))
    height = np.divide(total, count, out=np.full(len(at), np.nan), where=count > 0)
    return Offsets(height, deviation)


def mean_height(frames: Sequence[Offsets]) -> FloatArray:
    """Average heights over frames, (V,): the less they were disturbed along the surface, the more.

    NaN where no frame shows a vertex.
    """
    height = np.array([frame.height for frame in frames])
    seen = ~np.isnan(height)
    if not seen.any():
        return height[0]
    least = LEAST_NOISE * float(np.median(np.abs(height[seen]))) + TINY
    deviation = np.array([frame.deviation for frame in frames])
    weight = seen / np.maximum(deviation, least)[:, None] ** 2
    total = (weight * np.where(seen, height, 0.0)).sum(axis=0)
    known = weight.sum(axis=0)
    return np.divide(total, known, out=np.full(len(total), np.nan), where=known > 0.0)


def _next_to(P: FloatArray, V: FloatArray, F: IntArray, at: IntArray) -> IntArray:
    """Find which of some vertices (V,) of a reference points (n, 3) lie next to; -1 for none."""
    reach = NEXT * mean_edge_lengths(V, F)[at]
    distance, k = cKDTree(V[at]).query(P, distance_upper_bound=float(reach.max()))
    k = np.minimum(k, len(at) - 1)
    return np.where(distance <= reach[k], at[k], -1)


def _aligned(
    d: FloatArray, n: FloatArray, place: FloatArray, motion: FloatArray
) -> tuple[FloatArray, float]:
    """Take an affine map and motion out of offsets (n, 3), by what they do along the surface."""
    terms = np.column_stack([np.ones(len(place)), place])
    X = (terms[:, None, :, None] * np.eye(3)[:, None]).reshape(len(d), 3, -1)
    X = np.concatenate([X, _scaled(motion)[:, :, None]], axis=2)
    flat = _along(X, n)
    for _ in range(ROUNDS):
        along = _along(d, n)
        size = lengths(along)
        weight = np.minimum(1.0, CLIP * _deviation(size) / np.maximum(size, TINY))
        right = (weight[:, None, None] * flat).reshape(-1, X.shape[2])
        A = right.T @ flat.reshape(right.shape)
        A[np.diag_indices_from(A)] += RIDGE * np.trace(A) / len(A)
        d = d - X @ np.linalg.solve(A, right.T @ along.ravel())
    return d, _deviation(lengths(_along(d, n)))


def _along(x: FloatArray, n: FloatArray) -> FloatArray:
    """Take the part along normals (V, 3) from vectors (V, 3), or columns of them (V, 3, c)."""
    if x.ndim == 2:
        return x - n * np.einsum("ij,ij->i", n, x)[:, None]
    return x - n[:, :, None] * np.einsum("ij,ijc->ic", n, x)[:, None, :]


def _scaled(x: FloatArray) -> FloatArray:
    """Scale vectors (V, 3) to a root mean square of 1; 0 stays 0."""
    return x / (np.sqrt((x**2).sum(axis=1).mean()) or 1.0)


def _deviation(size: FloatArray) -> float:
    """Estimate the deviation of either component of vectors in a plane, by lengths (V,)."""
    return max(float(np.median(size)) / RAYLEIGH_MEDIAN, TINY)
