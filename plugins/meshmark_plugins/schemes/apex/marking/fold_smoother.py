"""Smooths the folds out of a displacement, before vertices have to be held back one by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, diags_array

from meshmark.arrays import FloatArray, IntArray
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
        self._F, self._root_area, self._poses = F, root_area, poses
        self._normals = [face_normals(P, F) for P, _ in poses]
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

    def folded_faces(self, moves: FloatArray, faces: IntArray) -> NDArray[np.bool_]:
        """Which of some faces (n,) tilt too far in some pose, (n,) bool, for moves (N, 3)."""
        F = self._F[faces]
        used = np.unique(F)
        folded = np.zeros(len(faces), dtype=bool)
        for (P, G), normals in zip(self._poses, self._normals, strict=True):
            X = P.copy()
            X[used] += self._root_area * np.einsum("nij,nj->ni", G[used], moves[used])
            before, after = normals[faces], face_normals(X, F)
            size = lengths(before) * lengths(after)
            folded |= np.einsum("ij,ij->i", before, after) < MIN_TILT_COSINE * size
        return folded
