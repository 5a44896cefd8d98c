"""The original in poses that it never takes, moved there by its own joints."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.skinning import Skinning

# Pull of a joint's map towards that of the whole, as a share of the mean square of what determines
# such maps: joints that move few points, or none, have no map of their own.
RIDGE = 1e-10
# Directions that joints flatten this much, relative to the others, say nothing of the rest pose.
FLAT = 1e-3


def moved_by_joints(skinning: Skinning, V: FloatArray, Q: FloatArray) -> FloatArray:
    """Move a surface to where a copy has its vertices, as far as its joints can.

    Each joint gets the affine map for which the squared distances are least: 12 numbers a joint
    are adapted to the copy, and nothing that stands out between them. What the joints do not
    explain of the surface, as marks and blend shapes, hangs on them.

    Parameters
    ----------
    skinning : Skinning
        Of the surface.
    V : (N, 3) float64
        Its vertices in any pose.
    Q : (N, 3) float64
        Where the copy has them.

    Returns
    -------
    (N, 3) float64

    References
    ----------
    N. Magnenat-Thalmann, R. Laperrière, D. Thalmann, "Joint-dependent local deformations for hand
    animation and object grasping", Graphics Interface 1988.
    """
    centre = skinning.rest.mean(axis=0)
    X = (skinning.rest - centre) / (float(np.abs(skinning.rest - centre).max()) or 1.0)
    at_rest = _Joints(skinning, X)
    linear, shift = at_rest.maps(V)
    hanging = V - np.einsum("ni,nij->nj", X, linear) - shift
    back = np.linalg.pinv(linear, rcond=FLAT)
    joints = _Joints(skinning, X + np.einsum("ni,nij->nj", hanging, back))
    linear, shift = joints.maps(Q)
    return np.einsum("ni,nij->nj", joints.X, linear) + shift


class _Joints:
    """Maps of joints that move points (N, 3) at rest to given places."""

    def __init__(self, skinning: Skinning, X: FloatArray) -> None:
        self.X, self._joints, self._weights = X, skinning.joints, skinning.weights
        N, n = self._joints.shape
        coordinates = np.column_stack([X, np.ones(N)])
        values = self._weights[:, :, None] * coordinates[:, None, :]
        columns: IntArray = 4 * self._joints[:, :, None] + np.arange(4)
        start = np.arange(0, 4 * N * n + 1, 4 * n)
        width = 4 * (int(self._joints.max()) + 1)
        self._A = csr_matrix((values.ravel(), columns.ravel(), start), shape=(N, width))
        self._whole = coordinates

    def maps(self, Q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Fit maps to places (N, 3); blend them into those of points, (N, 3, 3) and (N, 3)."""
        M = (self._A.T @ self._A).toarray()
        pull = RIDGE * (float(np.trace(M)) / len(M) or 1.0)
        M[np.diag_indices_from(M)] += pull
        whole = np.linalg.lstsq(self._whole, Q, rcond=None)[0]
        right = self._A.T @ Q + pull * np.tile(whole, (len(M) // 4, 1))
        T = np.linalg.solve(M, right).reshape(-1, 4, 3)
        blended = np.zeros((len(Q), 4, 3))
        for joint, weight in zip(self._joints.T, self._weights.T, strict=True):
            blended += weight[:, None, None] * T[joint]
        return blended[:, :3], blended[:, 3]
