"""How a surface turns and stretches about each vertex as its mesh moves."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix

from meshmark.arrays import FloatArray, IntArray
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

    def __init__(self, V: FloatArray, F: IntArray) -> None:
        E, n = edges(F), len(V)
        i, j = np.concatenate([E, E[:, ::-1]]).T
        order = np.argsort(i, kind="stable")
        self._i, self._j = i[order], j[order]
        degree = np.bincount(i, minlength=n)
        start = np.concatenate([[0], np.cumsum(degree)])
        self._sum = csr_matrix((np.ones(len(i)), np.arange(len(i)), start), shape=(n, len(i)))

        e = self._edges(V)
        square = np.einsum("hc,hc->h", e, e)
        mean_square = (self._sum @ square) / np.maximum(degree, 1)
        floor = square + _SHORT**2 * mean_square[self._i]
        weight = np.divide(1.0, floor * degree[self._i], out=np.zeros_like(floor), where=floor > 0)

        spread, U = np.linalg.eigh(self._outer_sums(weight[:, None] * e, e))
        # Largest first, and right-handed, so that the cross product of images keeps the side.
        first, second = U[:, :, 2], U[:, :, 1]
        self._axes = np.stack([first, second, np.cross(first, second)], axis=2)
        self._known = spread[:, [2, 1]] > _FLAT
        inverse = np.divide(1.0, spread[:, [2, 1]], out=np.zeros((n, 2)), where=self._known)
        along = np.einsum("hc,hck->hk", e, self._axes[self._i, :, :2])
        self._share = weight[:, None] * along * inverse[self._i]

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
        images = self._outer_sums(self._edges(V), self._share)
        images = np.where(self._known[:, None, :], images, self._axes[:, :, :2])
        n = np.cross(images[:, :, 0], images[:, :, 1])
        area = lengths(n)[:, None]
        n = np.divide(n, np.sqrt(area), out=np.zeros_like(n), where=area > 0)
        return np.concatenate([images, n[:, :, None]], axis=2) @ np.swapaxes(self._axes, 1, 2)

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

    def _edges(self, V: FloatArray) -> FloatArray:
        """Compute each vertex's edges to its neighbours, vertex after vertex, (2E, 3)."""
        return V[self._j] - V[self._i]

    def _outer_sums(self, X: FloatArray, Y: FloatArray) -> FloatArray:
        """Sum the outer products of vectors of each vertex's edges, (N, X's width, Y's width)."""
        products = (X[:, :, None] * Y[:, None, :]).reshape(len(X), -1)
        return (self._sum @ products).reshape(-1, X.shape[1], Y.shape[1])
