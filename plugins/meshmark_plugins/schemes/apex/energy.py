"""What a displacement costs: leaving the surface, stretching triangles, moving far."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_matrix, csr_matrix

from meshmark.geometry import area_vectors, face_areas, sum_at_corners, unit, vertex_areas
from meshmark_plugins.schemes.apex.density import stiffness

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Spread of the normals about a vertex at which sliding costs twice what it costs on a plane.
FLATNESS = 0.01
# Weight of stretching beside moving, for stretches over a bin.
STIFFNESS = 3.0
# A triangle of a mean area's share below 1 / SLIVER is no stiffer than that.
SLIVER = 50.0
# About an anchor vertices hardly move, or it would be found elsewhere; in root areas.
GUARD = 0.05
# What a guarded vertex moves at most, as a share of what it would.
LEAST_MOBILITY = 1e-3


@dataclass(frozen=True, eq=False)
class Energy:
    """A quadratic cost of displacements, in units of the mesh's root area.

    Parameters
    ----------
    blocks : (N, 3, 3) float64
        Cost of moving each vertex, by direction.
    stretch : (N, N) sparse float64
        Cost of moving neighbours apart, the same for each coordinate.
    """

    blocks: FloatArray
    stretch: csr_matrix

    def weighted(self, factor: FloatArray) -> WeightedEnergy:
        """Make moving vertex i `factor[i]` times as dear."""
        return WeightedEnergy(self.blocks * factor[:, None, None], self.stretch)


@dataclass(frozen=True, eq=False)
class WeightedEnergy:
    """An energy as an operator on displacements (3 N,), with its inverse block diagonal."""

    blocks: FloatArray
    stretch: csr_matrix

    def __matmul__(self, d: FloatArray) -> FloatArray:
        moves = d.reshape(-1, 3)
        own = np.einsum("nij,nj->ni", self.blocks, moves)
        result: FloatArray = (own + self.stretch @ moves).ravel()
        return result

    def inverse_blocks(self) -> bsr_matrix:
        """Invert the block diagonal, (3 N, 3 N) sparse."""
        n = len(self.blocks)
        diagonal = self.stretch.diagonal()[:, None, None] * np.eye(3)
        inverse = np.linalg.inv(self.blocks + diagonal)
        return bsr_matrix((inverse, np.arange(n), np.arange(n + 1)), shape=(3 * n, 3 * n))


def normal_spread(V: FloatArray, F: IntArray) -> FloatArray:
    """Mean of n n^T over the triangles about each vertex, by area, (N, 3, 3).

    On a plane it is n n^T; the more the surface bends, the more of it lies in the tangents.
    """
    vectors = area_vectors(V, F)
    areas, n = np.linalg.norm(vectors, axis=1), unit(vectors)
    outer = (areas[:, None, None] * n[:, :, None] * n[:, None, :]).reshape(-1, 9)
    about = np.maximum(sum_at_corners(areas, F, len(V)), 1e-300)
    spread: FloatArray = (sum_at_corners(outer, F, len(V)) / about[:, None]).reshape(-1, 3, 3)
    return spread


def sliding_cost(V: FloatArray, F: IntArray) -> FloatArray:
    """Cost of moving each vertex by direction, (N, 3, 3): 1 along planes, much more off them."""
    cost: FloatArray = normal_spread(V, F) / FLATNESS + np.eye(3)
    return cost


def stretching_cost(V: FloatArray, F: IntArray, width: float) -> csr_matrix:
    """Cost of stretching, (N, N) sparse.

    The sum over triangles of |grad d|^2, each counted with the mean area: a sliver folds as
    easily as any other triangle, so that stretching it must not be cheaper.
    """
    areas = face_areas(V, F)
    mean = areas.mean()
    heavier = np.minimum(mean / np.maximum(areas, 1e-12 * mean), SLIVER)
    weights = np.empty(F.shape)
    for k in range(3):
        u = V[F[:, (k + 1) % 3]] - V[F[:, k]]
        v = V[F[:, (k + 2) % 3]] - V[F[:, k]]
        across = np.maximum(np.linalg.norm(np.cross(u, v), axis=1), 2e-3 * mean)
        weights[:, k] = 0.5 * heavier * np.einsum("ij,ij->i", u, v) / across
    length = width / (2.0 * np.pi)
    return csr_matrix(STIFFNESS * length**2 * stiffness(F, weights, len(V)))


def guarded(H: FloatArray) -> FloatArray:
    """How much dearer moves are near anchors, (n,), from distances (m, n) in root areas."""
    mobility = np.prod(1.0 - np.exp(-((H / GUARD) ** 2)), axis=0)
    dearer: FloatArray = np.maximum(mobility, LEAST_MOBILITY) ** -2.0
    return dearer


def energy_over_poses(
    poses: list[tuple[FloatArray, FloatArray]], V: FloatArray, F: IntArray, width: float
) -> Energy:
    """Cost of a displacement of V (N, 3) that is carried through several poses.

    Parameters
    ----------
    poses : list of ((N, 3), (N, 3, 3)) float64
        Positions in each pose, and the gradients that carry displacements there.
    """
    carried = [
        np.einsum("nji,njk,nkl->nil", G, sliding_cost(P, F), G, optimize=True) for P, G in poses
    ]
    share = vertex_areas(V, F)
    share = share / share.sum()
    return Energy(
        blocks=np.mean(carried, axis=0) * share[:, None, None],
        stretch=stretching_cost(V, F, width),
    )
