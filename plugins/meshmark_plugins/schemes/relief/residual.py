"""How high a copy stands above its reference, without what honest programs do to a surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import csr_matrix

from meshmark.arrays import FloatArray, IntArray
from meshmark.extension.informed import AlignedFrame
from meshmark.mesh.closest_points import ClosestPoints
from meshmark.mesh.geometry import normalized, surface_box, vertex_normals
from meshmark.mesh.smoothing import polygon_umbrella, smooth
from meshmark_plugins.schemes.relief.chips import MAD_TO_SIGMA, Heights
from meshmark_plugins.schemes.relief.treatment import NONE, Treatment

# Vertices farther from the reference than this share of the diagonal, or whose normals differ by
# more than this cosine, lie on something else.
REACH, AGREEMENT = 0.02, 0.5
# Steps of smoothing whose displacement is taken out of the heights, linearly.
SMOOTHINGS = (3, 12, 48)
# Heights beyond so many standard deviations are cut to that.
CLIP = 3.0
FIT_ROUNDS = 3
# Fewest vertices that a fit is made of.
FEWEST = 32


def heights(
    view: AlignedFrame, treatment: Treatment = NONE, *, by_identity: bool = False
) -> Heights:
    """Measure a copy's heights above the reference.

    Parameters
    ----------
    view : AlignedFrame
        The frame of a copy, and of the reference.
    treatment : Treatment
        What the reference is taken through first.
    by_identity : bool
        Whether each of the copy's vertices is compared with its own vertex of the reference, not
        with the closest point. Noise bends closest points towards creases, in all frames alike;
        but vertices that slid along the surface are better compared with those.
    """
    W, reference = treatment.surface(view.reference)
    view = replace(view, reference=reference, motion=W @ view.motion)
    V, F = reference.points, reference.faces
    n_points = W.shape[1]
    face, weight, d, on = (_offsets if by_identity else _signed_distances)(view, V, F)
    if on.sum() < FEWEST:
        return Heights.of_nothing(n_points)
    face, weight, d = face[on], weight[on], d[on]
    X = _at(_columns(view, V, F), F, face, weight)
    left, deviation = _without(X, d)
    start = np.arange(0, 3 * len(face) + 1, 3)
    places = csr_matrix((weight.ravel(), F[face].ravel(), start), shape=(len(face), len(V)))
    return _carried(left, csr_matrix(places @ W), deviation)


def _carried(left: FloatArray, places: csr_matrix, deviation: float) -> Heights:
    """Carry heights (n,) to the vertices that each place is a mean of, by weights (n, N)."""
    n_points = places.shape[1]
    back, ones = places.T, np.ones(len(left))
    count, total, square = back @ ones, back @ left, back.power(2) @ ones
    seen = count > 0.0
    value = np.divide(total, count, out=np.zeros(n_points), where=seen)
    scatter = np.divide(square, count**2, out=np.ones(n_points), where=seen)
    return Heights(value, count, scatter, deviation)


def _signed_distances(
    view: AlignedFrame, V: FloatArray, F: IntArray
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Find each vertex's triangle, place and height there, and which lie on the surface."""
    face, weight = ClosestPoints(V, F).find(view.points)
    normal = normalized(_at(vertex_normals(V, F), F, face, weight))
    offset = view.points - _at(V, F, face, weight)
    d = np.einsum("ij,ij->i", offset, normal)
    near = np.linalg.norm(offset, axis=1) < REACH * surface_box(V, F)[0]
    cosine = np.einsum("ij,ij->i", view.normals, normal)
    # The faces of a mirrored copy may be inside out, all of them.
    agreeing = (
        np.copysign(1.0, np.median(cosine[near])) * cosine > AGREEMENT if near.any() else near
    )
    return face, weight, d, near & agreeing


def _offsets(
    view: AlignedFrame, V: FloatArray, F: IntArray
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Take each vertex's own vertex of the reference for its place; as `_signed_distances`."""
    assert view.vertices is not None
    corner = np.full(len(V), -1)
    corner[F.ravel()[::-1]] = np.arange(F.size)[::-1]
    face, k = np.divmod(corner[view.vertices], 3)
    offset = view.points - V[view.vertices]
    d = np.einsum("ij,ij->i", offset, vertex_normals(V, F)[view.vertices])
    near = np.linalg.norm(offset, axis=1) < REACH * surface_box(V, F)[0]
    return face, np.eye(3)[k], d, near


def _columns(view: AlignedFrame, V: FloatArray, F: IntArray) -> FloatArray:
    """Heights (N, c) that an alignment not quite right, and smoothing, would show."""
    n = vertex_normals(V, F)
    diagonal, centre = surface_box(V, F)
    local = (V - centre) / diagonal
    affine = [n, *(n * x[:, None] for x in local.T)]
    motion = np.einsum("ij,ij->i", view.motion, n)
    columns = [np.ones((len(V), 1)), *affine, motion[:, None]]
    L = polygon_umbrella(view.reference.topology)
    done, P = 0, V
    for steps in SMOOTHINGS:
        P, done = smooth(P, L, steps - done), steps
        sunk = np.einsum("ij,ij->i", P - V, n)[:, None]
        columns += [sunk, np.abs(sunk)]
    return np.hstack(columns)


def _at(x: FloatArray, F: IntArray, face: IntArray, weight: FloatArray) -> FloatArray:
    """Interpolate values (N, c) of vertices at places in triangles."""
    return np.einsum("ij,ijc->ic", weight, x[F[face]])


def _without(X: FloatArray, d: FloatArray) -> tuple[FloatArray, float]:
    """Take out of heights (n,) what columns (n, c) explain, robustly; and cut outliers."""
    scale = np.sqrt((X**2).mean(axis=0))
    X = X[:, scale > 0.0] / scale[scale > 0.0]
    weight = np.ones(len(d))
    left, sigma = d, _deviation(d)
    for _ in range(FIT_ROUNDS):
        A = X.T @ (X * weight[:, None])
        A[np.diag_indices_from(A)] += 1e-9 * np.trace(A) / len(A)
        left = d - X @ np.linalg.solve(A, X.T @ (weight * d))
        sigma = _deviation(left)
        weight = np.minimum(1.0, CLIP * sigma / np.maximum(np.abs(left), 1e-300))
    return np.clip(left, -CLIP * sigma, CLIP * sigma), sigma


def _deviation(x: FloatArray) -> float:
    return max(MAD_TO_SIGMA * float(np.median(np.abs(x - np.median(x)))), 1e-300)
