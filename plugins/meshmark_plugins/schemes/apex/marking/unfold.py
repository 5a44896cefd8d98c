"""Takes the folds out of a displacement before they have to be held back vertex by vertex."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, diags_array

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.flip_guard import face_normals
from meshmark.mesh.geometry import lengths
from meshmark.mesh.topology import vertex_adjacency

ITERATIONS = 20
# A face that tilts by more than this cosine is ironed: sooner than it would be held back, whose
# corners' moves are halved and then fold the faces beside it.
LEAST_COSINE = 0.35


class Folds:
    """Finds and irons out the folds that a displacement makes in some poses.

    Parameters
    ----------
    F : (F, 3) int
        Triangles.
    root_area : float
        Length of a unit of displacement.
    poses : list of ((N, 3), (N, 3, 3)) float64
        Positions in each pose, and the gradients that carry displacements there.
    """

    def __init__(
        self, F: IntArray, root_area: float, poses: list[tuple[FloatArray, FloatArray]]
    ) -> None:
        self._F, self._root_area, self._poses = F, root_area, poses
        self._normals = [face_normals(P, F) for P, _ in poses]
        adjacency = vertex_adjacency(F, len(poses[0][0])).astype(np.float64)
        degree = np.maximum(np.asarray(adjacency.sum(axis=1)).ravel(), 1.0)
        self._mean = csr_matrix(diags_array(1.0 / degree) @ adjacency)

    def ironed(self, d: FloatArray) -> FloatArray:
        """Move the corners of folds half way to the mean of their neighbours, again and again.

        Parameters
        ----------
        d : (3 N,) float64
            Displacement, in root areas.

        Returns
        -------
        (3 N,) float64
            With few folds left; none is promised.
        """
        moves = d.reshape(-1, 3).copy()
        for _ in range(ITERATIONS):
            corners = np.unique(self._F[self.found(moves)])
            if corners.size == 0:
                break
            moves[corners] = 0.5 * (moves[corners] + self._mean[corners] @ moves)
        return moves.ravel()

    def found(self, moves: FloatArray) -> NDArray[np.bool_]:
        """Which faces tilt too far in some pose, (F,) bool, for moves (N, 3)."""
        folded = np.zeros(len(self._F), dtype=bool)
        for (P, G), before in zip(self._poses, self._normals, strict=True):
            X = P + self._root_area * np.einsum("nij,nj->ni", G, moves)
            after = face_normals(X, self._F)
            size = lengths(before) * lengths(after)
            folded |= np.einsum("ij,ij->i", before, after) < LEAST_COSINE * size
        return folded
