"""How a surface turns and stretches about each vertex as its mesh moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from meshmark.arrays import FloatArray, IntArray
from meshmark.kernels import compiled
from meshmark.mesh.geometry import lengths
from meshmark.mesh.topology import edges

# Edges shorter than this share of their one-ring's RMS length gain no further weight: their
# direction is noise.
_SHORT = 1e-3

# Smallest mean square of the edges' cosines with a direction that they tell anything about.
_FLAT = 1e-8


class Deformation:
    """Built once on a reference, asked many times how it was deformed.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions of the reference.
    F : (F, 3) int
        Triangles; those without area and unused vertices are allowed.
    rings : OneRings, optional
        Of these triangles, if they are known, or of some of their vertices: gradients, and vectors
        that are carried, are of these n vertices then.

    Notes
    -----
    The gradient G of a vertex is fitted to its edges e, which became e', by least squares of
    G e - e' with weights 1 / |e|^2. The edges of a flat one-ring say nothing of the direction
    across it, and those of a nearly flat one only how its curvature changed. So they decide in
    the two principal directions that they spread over most, the tangent plane of a smooth
    surface, and the third goes with the normal as in [1]_: the cross product n of the images of
    the first two, divided by sqrt(|n|) to be as long as their area asks.

    G is therefore exact for rotations, translations and uniform scaling, also of flat meshes.
    For another affine map it is exact in the two principal directions; the image of the third
    is at a right angle to theirs, whatever the map does there.

    A direction that the edges do not spread over keeps its place if it is one of the first
    two: an isolated vertex, or one whose edges have no length, gets the identity.

    References
    ----------
    .. [1] R. W. Sumner, J. Popović, "Deformation Transfer for Triangle Meshes", ACM Transactions
       on Graphics 23(3), 399-405, 2004.
    """

    def __init__(self, V: FloatArray, F: IntArray, rings: OneRings | None = None) -> None:
        self._rings = OneRings(F, len(V)) if rings is None else rings
        start, i, j = self._rings.start, self._rings.here, self._rings.neighbours
        n, degree = len(start) - 1, np.diff(start)
        V = self._rings.ordered(V)

        e = V[j] - V[i]
        square = np.einsum("hc,hc->h", e, e)
        mean_square = (_sums(start) @ square) / np.maximum(degree, 1)
        floor = square + _SHORT**2 * mean_square[i]
        weight = np.divide(1.0, floor * degree[i], out=np.zeros_like(floor), where=floor > 0)

        spread, U = np.linalg.eigh(_outer_sums(start, weight[:, None] * e, e))
        # Largest first, and right-handed, so that the cross product of images keeps the side.
        first, second = U[:, :, 2], U[:, :, 1]
        self._axes = np.stack([first, second, np.cross(first, second)], axis=2)
        self._known = spread[:, [2, 1]] > _FLAT
        inverse = np.divide(1.0, spread[:, [2, 1]], out=np.zeros((n, 2)), where=self._known)
        along = np.einsum("hc,hck->hk", e, self._axes[i, :, :2])
        self._share = weight[:, None] * along * inverse[i]

    def gradients(self, V: FloatArray) -> FloatArray:
        """Compute the deformation gradients to other positions of the same vertices.

        Parameters
        ----------
        V : (N, 3) float64
            Vertex positions after the deformation.

        Returns
        -------
        (N, 3, 3) float64
            G of each vertex: what was a short vector v there is G v now.
        """
        rings = self._rings
        V = rings.ordered(V)
        return fitted_gradients(
            V, rings.start, rings.neighbours, self._share, self._axes, self._known
        )

    def carry(self, D: FloatArray, V: FloatArray) -> FloatArray:
        """Carry a vector of each vertex along with the surface.

        Parameters
        ----------
        D : (N, 3) float64
            Vectors on the reference.
        V : (N, 3) float64
            Vertex positions after the deformation.

        Returns
        -------
        (N, 3) float64
            The vectors that are to V what D was to the reference: G D.
        """
        return np.einsum("nij,nj->ni", self.gradients(V), D)


class OneRings:
    """The neighbours of vertices, in one list.

    Parameters
    ----------
    F : (F, 3) int
        Triangles.
    n_points : int
        N.
    at : (n,) int, optional
        Of which vertices; all by default.

    Attributes
    ----------
    start : (n + 1,) int
        Where the neighbours of each vertex begin.
    here, neighbours : (H,) int
        Each vertex and its neighbours, vertex after vertex, as they are `ordered`.
    """

    def __init__(self, F: IntArray, n_points: int, at: IntArray | None = None) -> None:
        E = edges(F)
        i, j = np.concatenate([E, E[:, ::-1]]).T
        self._order: IntArray | None = None
        n = n_points
        if at is not None:
            n, rest = len(at), np.ones(n_points, dtype=bool)
            rest[at] = False
            self._order = np.concatenate([at, np.flatnonzero(rest)])
            place = np.empty(n_points, dtype=np.int64)
            place[self._order] = np.arange(n_points)
            kept = place[i] < n
            i, j = place[i[kept]], place[j[kept]]
        order = np.argsort(i, kind="stable")
        self.here, self.neighbours = i[order], j[order]
        self.start = np.concatenate([[0], np.cumsum(np.bincount(i, minlength=n))])

    def ordered(self, V: FloatArray) -> FloatArray:
        """Put the vertices (N, 3) whose neighbours are listed before all others."""
        return V if self._order is None else V[self._order]


@compiled
def fitted_gradients(
    V: FloatArray,
    start: IntArray,
    neighbours: IntArray,
    share: FloatArray,
    axes: FloatArray,
    known: NDArray[np.bool_],
) -> FloatArray:
    """Fit the gradients of the first vertices of V (N, 3) to edges to their neighbours, (n, 3, 3).

    Parameters
    ----------
    start : (n + 1,) int
        Where the neighbours of each vertex begin.
    neighbours : (2E,) int
        Neighbours of vertex after vertex.
    share : (2E, 2) float64
        Share of each edge in the images of the first two axes.
    axes : (n, 3, 3) float64
        Principal directions of the reference, as columns.
    known : (n, 2) bool
        Which of the first two the edges tell of; others keep their place.
    """
    here = np.repeat(np.arange(len(start) - 1), np.diff(start))
    images = _outer_sums(start, V[neighbours] - V[here], share)
    images = np.where(known[:, None, :], images, axes[:, :, :2])
    n = np.cross(images[:, :, 0], images[:, :, 1])
    area = lengths(n)[:, None]
    n = np.divide(n, np.sqrt(area), out=np.zeros_like(n), where=area > 0)
    return np.concatenate([images, n[:, :, None]], axis=2) @ np.swapaxes(axes, 1, 2)


def _outer_sums(start: IntArray, X: FloatArray, Y: FloatArray) -> FloatArray:
    """Sum the outer products of vectors of each vertex's edges, (N, X's width, Y's width)."""
    products = (X[:, :, None] * Y[:, None, :]).reshape(len(X), -1)
    return (_sums(start) @ products).reshape(-1, X.shape[1], Y.shape[1])


def _sums(start: IntArray) -> csr_matrix:
    """Build the matrix that sums over the edges of each vertex, (N, 2E) sparse."""
    n = int(start[-1])
    return csr_matrix((np.ones(n), np.arange(n), start), shape=(len(start) - 1, n))
