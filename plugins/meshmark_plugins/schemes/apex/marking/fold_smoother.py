"""Smooths the folds out of a displacement, before vertices have to be held back one by one."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix, diags_array

from meshmark.arrays import BoolArray, FloatArray, IntArray
from meshmark.kernels import compiled
from meshmark.mesh.flip_guard import face_normals
from meshmark.mesh.geometry import lengths
from meshmark.mesh.topology import any_corner, vertex_adjacency

FOLD_SMOOTHING_ITERATIONS = 20
# A face folds if the cosine of its tilt is less than this: it is smoothed sooner than the flip
# guard would hold it back, which halves its corners' moves, and so folds the faces beside it.
MIN_TILT_COSINE = 0.35


class FoldSmoother:
    """Finds and smooths the folds that a displacement makes in some poses.

    Parameters
    ----------
    F : (F, 3) int
        Triangles.
    root_area : float
        Length in which displacements are given.
    poses : list of ((N, 3), (N, 3, 3)) float64
        Positions in each pose, and the gradients that carry displacements there.
    """

    def __init__(
        self, F: IntArray, root_area: float, poses: list[tuple[FloatArray, FloatArray]]
    ) -> None:
        self._F, self._poses = F, [(P, root_area * G) for P, G in poses]
        adjacency = vertex_adjacency(F, len(poses[0][0])).astype(np.float64)
        degree = np.maximum(np.asarray(adjacency.sum(axis=1)).ravel(), 1.0)
        self._mean = csr_matrix(diags_array(1.0 / degree) @ adjacency)

    def smooth_folds(self, d: FloatArray) -> FloatArray:
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
        suspects = np.arange(len(self._F))
        for _ in range(FOLD_SMOOTHING_ITERATIONS):
            corners = np.unique(self._F[suspects[self.folded_faces(moves, suspects)]])
            if corners.size == 0:
                break
            moves[corners] = 0.5 * (moves[corners] + self._mean[corners] @ moves)
            # No other face has changed; those that were folded are among these.
            moved = np.zeros(len(moves), dtype=bool)
            moved[corners] = True
            suspects = np.flatnonzero(any_corner(moved, self._F))
        return moves.ravel()

    def folded_faces(self, moves: FloatArray, faces: IntArray) -> BoolArray:
        """Which of some faces (n,) tilt too far in some pose, (n,) bool, for moves (N, 3)."""
        folded = np.zeros(len(faces), dtype=bool)
        for P, G in self._poses:
            folded |= tilted_faces(P, G, self._F, faces, moves, MIN_TILT_COSINE)
        return folded


@compiled
def tilted_faces(
    V: FloatArray,
    G: FloatArray,
    F: IntArray,
    faces: IntArray,
    moves: FloatArray,
    least_cosine: float,
) -> BoolArray:
    """Which of some triangles (n,) tilt by a smaller cosine, (n,), for moves (N, 3) times G."""
    corners = F[faces]
    used = np.unique(corners)
    X = V.copy()
    X[used] += np.einsum("nij,nj->ni", G[used], moves[used])
    before, after = face_normals(V, corners), face_normals(X, corners)
    size = lengths(before) * lengths(after)
    return np.einsum("ij,ij->i", before, after) < least_cosine * size
