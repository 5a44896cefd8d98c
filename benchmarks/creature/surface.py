"""The creature's rest mesh: the implicit surface sampled by quads, evened out."""

from __future__ import annotations

import numpy as np

from creature.flesh import Capsule, cut_soles, field, reach, smooth_union
from creature.nets import dual_quads
from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import UsageError
from meshmark.mesh.topology import edges, face_adjacency, triangulate, vertex_adjacency

# The sampling grid stands askew, so that no ring of vertices lies square to a limb: a mesh made
# by a person or a scanner has none either, and none should flatter a measurement.
_GRID_TURNS = (0.47, 0.61, 0.29)
# Where a corner of the grid falls on a thin tip is luck: these places are tried in turn.
_GRID_OFFSETS = tuple((0.382 * i % 1, 0.618 * i % 1, 0.217 * i % 1) for i in range(5))
_RELAX_ROUNDS = 30
# Cosine between the normals of two neighbouring faces below which the skin counts as folded.
_SHARPEST_FOLD = -0.2


def rest_mesh(flesh: tuple[Capsule, ...], points: int) -> tuple[FloatArray, IntArray]:
    """Sample the creature's surface with about the wanted number of points.

    Parameters
    ----------
    flesh : tuple of Capsule
        The implicit surface.
    points : int
        Wanted number of points; met within about 5 %. Below some 6000 the skin may be creased
        at the tips of the ears and the edges of the hooves.

    Returns
    -------
    V : (N, 3) float64
        Vertex positions on the surface.
    Q : (P, 4) int
        Quads, counter-clockwise seen from outside, each beginning at the end of its shorter
        diagonal, so that the fan of triangles about the first corner is the better one.

    Raises
    ------
    UsageError
        If so few points cannot sample the thinnest parts.
    """
    size = _cell_size(flesh, points)
    best, best_fold = None, -np.inf
    for offset in _GRID_OFFSETS:
        V, Q = sample(flesh, size, np.array(offset))
        if not is_closed_sphere(_triangles(Q), len(V)):
            continue
        V = relax(V, Q, flesh, _RELAX_ROUNDS)
        Q = _shorter_diagonal_first(V, Q)
        fold = sharpest_fold(V, _triangles(Q))
        if fold > best_fold:
            best, best_fold = (V, Q), fold
        if fold > _SHARPEST_FOLD:
            break
    if best is None:
        raise UsageError(f"{points} points are too few for the creature's thin parts; ask for more")
    return best


def _triangles(Q: IntArray) -> IntArray:
    return triangulate(np.full(len(Q), 4), Q.reshape(-1))


def _cell_size(flesh: tuple[Capsule, ...], points: int) -> float:
    """Find the grid's cell size, from the count a trial size gives: it goes as size^-2."""
    size = 3.2
    for _ in range(2):
        V, _ = sample(flesh, size, np.zeros(3))
        size *= float(np.sqrt(len(V) / points))
    return size


def sample(
    flesh: tuple[Capsule, ...], size: float, offset: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Sample the field on the askew grid and polygonise it.

    Parameters
    ----------
    flesh : tuple of Capsule
        The implicit surface.
    size : float
        Length of a cell.
    offset : (3,) float64
        Shift of the grid, in cells.

    Returns
    -------
    V : (N, 3) float64
        Vertex positions near the surface.
    Q : (P, 4) int
        Quads, counter-clockwise seen from outside.
    """
    axes = _grid_axes()
    bounds = np.array([capsule.bounds(axes, 0.0) for capsule in flesh])
    base = bounds[:, 0].min(axis=0) - (2 + offset) * size
    shape = np.ceil((bounds[:, 1].max(axis=0) - base) / size).astype(int) + 2
    V, Q = dual_quads(_field_on_grid(flesh, axes, base, size, shape))
    return (base + size * V) @ axes.T, Q


def _grid_axes() -> FloatArray:
    """Return the axes of the sampling grid as columns, (3, 3)."""
    axes = np.eye(3)
    for i, turn in enumerate(_GRID_TURNS):
        j, k = (i + 1) % 3, (i + 2) % 3
        R = np.eye(3)
        R[j, j] = R[k, k] = np.cos(turn)
        R[k, j], R[j, k] = np.sin(turn), -np.sin(turn)
        axes = axes @ R
    return axes


def _field_on_grid(
    flesh: tuple[Capsule, ...], axes: FloatArray, base: FloatArray, size: float, shape: IntArray
) -> FloatArray:
    """Evaluate the field at grid corners, each capsule only in its own box."""
    margin = reach(flesh)
    value = np.full(tuple(shape), margin)
    for capsule in flesh:
        low, high = capsule.bounds(axes, margin)
        start = np.maximum(np.floor((low - base) / size).astype(int), 0)
        stop = np.minimum(np.ceil((high - base) / size).astype(int) + 1, shape)
        box = tuple(slice(*span) for span in zip(start, stop, strict=True))
        X = (base + size * _corners(start, stop)) @ axes.T
        none = np.zeros_like(X)
        d, _ = capsule.distance(X)
        merged, _ = smooth_union(value[box].reshape(-1), none, d, none, capsule.blend)
        value[box] = merged.reshape(value[box].shape)
    X = (base + size * _corners(np.zeros(3, dtype=int), shape)) @ axes.T
    return cut_soles(X, value.reshape(-1), np.zeros_like(X))[0].reshape(value.shape)


def _corners(start: IntArray, stop: IntArray) -> IntArray:
    spans = [np.arange(a, b) for a, b in zip(start, stop, strict=True)]
    return np.stack(np.meshgrid(*spans, indexing="ij"), axis=-1).reshape(-1, 3)


def is_closed_sphere(F: IntArray, n_points: int) -> bool:
    """Tell whether every edge has two faces, one each way, and the Euler characteristic is 2."""
    half = np.concatenate([F[:, [0, 1]], F[:, [1, 2]], F[:, [2, 0]]])
    key = np.sort(half[:, 0] * n_points + half[:, 1])
    back = np.sort(half[:, 1] * n_points + half[:, 0])
    oriented = np.array_equal(key, back) and bool(np.all(np.diff(key) > 0))
    return oriented and n_points - len(edges(F)) + len(F) == 2


def sharpest_fold(V: FloatArray, F: IntArray) -> float:
    """Return the smallest cosine between the normals of two faces that share an edge."""
    n = np.cross(V[F[:, 1]] - V[F[:, 0]], V[F[:, 2]] - V[F[:, 0]])
    n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-30)
    pairs, _ = face_adjacency(F)
    return float(np.einsum("ij,ij->i", n[pairs[:, 0]], n[pairs[:, 1]]).min())


def relax(V: FloatArray, Q: IntArray, flesh: tuple[Capsule, ...], rounds: int) -> FloatArray:
    """Even out the vertices along the surface: umbrella steps, each put back on the surface.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions near the surface.
    Q : (P, 4) int
        Quads.
    flesh : tuple of Capsule
        The implicit surface.
    rounds : int
        Number of steps.

    Returns
    -------
    (N, 3) float64
        Vertex positions on the surface.
    """
    # A quad's corners are all neighbours: both diagonals hold it square.
    triangles = np.concatenate([Q[:, [0, 1, 2]], Q[:, [2, 3, 0]], Q[:, [1, 2, 3]]])
    A = vertex_adjacency(triangles, len(V))
    degree = np.asarray(A.sum(axis=1)).reshape(-1, 1)
    V = project(V, flesh)
    for _ in range(rounds):
        step = A @ V / degree - V
        # Along the surface only: a full step would pull a tip's vertices through one another.
        n = field(V, flesh)[1]
        n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-9)
        step -= np.sum(step * n, axis=1, keepdims=True) * n
        V = project(V + 0.5 * step, flesh)
    return project(V, flesh)


def project(V: FloatArray, flesh: tuple[Capsule, ...]) -> FloatArray:
    """Take a Newton step along the field's gradient to the zero set, (N, 3)."""
    value, g = field(V, flesh)
    steep = np.maximum(np.einsum("ij,ij->i", g, g), 0.05)
    return V - (value / steep)[:, None] * g


def _shorter_diagonal_first(V: FloatArray, Q: IntArray) -> IntArray:
    P = V[Q]
    first = np.linalg.norm(P[:, 0] - P[:, 2], axis=1)
    second = np.linalg.norm(P[:, 1] - P[:, 3], axis=1)
    return np.where((first <= second)[:, None], Q, np.roll(Q, -1, axis=1))
