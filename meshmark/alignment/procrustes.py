"""The similarity between points that are paired."""

from __future__ import annotations

import numpy as np

from meshmark.alignment.robust import scale_of, tukey
from meshmark.arrays import FloatArray

# Share of its greatest extent, squared, below which a shape is flat.
FLAT = 1e-6
ROUNDS = 30


def similarity(
    X: FloatArray, Y: FloatArray, w: FloatArray, *, mirrors: bool | None = None
) -> FloatArray:
    """Find the map x -> s R x + t with the least weighted squares, mirrors included.

    Parameters
    ----------
    X, Y : (n, 3) float64
        Points and what they are to be mapped to.
    w : (n,) float64
        Weights, not all zero.
    mirrors : bool, optional
        Whether it is to be a mirror image; by default, where that fits better.

    Returns
    -------
    (3, 4) float64
        [s R | t].

    References
    ----------
    S. Umeyama, "Least-squares estimation of transformation parameters between two point
    patterns", IEEE Trans. PAMI 13(4), 1991, doi:10.1109/34.88573.
    """
    w = w / w.sum()
    mean_x, mean_y = w @ X, w @ Y
    x, y = X - mean_x, Y - mean_y
    U, D, Vt = np.linalg.svd((y * w[:, None]).T @ x)
    # What is flat is its own mirror image: it is turned instead.
    flat = D[2] <= FLAT * D[0]
    turned = np.sign(np.linalg.det(U @ Vt))
    last = (turned if flat else 1.0) if mirrors is None else (-turned if mirrors else turned)
    S = np.array([1.0, 1.0, last])
    spread = float(w @ (x * x).sum(axis=1))
    A = (D @ S) / spread * (U * S) @ Vt if spread > 0 else np.eye(3)
    return np.column_stack([A, mean_y - A @ mean_x])


def robust_similarity(X: FloatArray, Y: FloatArray) -> FloatArray:
    """Find the similarity between most of the pairs: Tukey's weights, until they stay.

    Parameters
    ----------
    X, Y : (n, 3) float64
        Points and what they are to be mapped to.

    Returns
    -------
    (3, 4) float64
    """
    w = np.ones(len(X))
    A = similarity(X, Y, w)
    floor = 1e-9 * float(np.ptp(Y, axis=0).max())
    for _ in range(ROUNDS):
        distance = np.linalg.norm(X @ A[:, :3].T + A[:, 3] - Y, axis=1)
        new = tukey(distance, max(scale_of(distance), floor))
        A = similarity(X, Y, new)
        if np.abs(new - w).max() < 1e-4:
            break
        w = new
    return A


def misfits(X: FloatArray, Y: FloatArray) -> FloatArray:
    """Measure how well each of many poses fits under its own similarity.

    Parameters
    ----------
    X : (n, 3) float64
    Y : (T, n, 3) float64

    Returns
    -------
    (T,) float64
        Mean squared distance under the best similarity, mirrors included.
    """
    x = X - X.mean(axis=0)
    y = Y - Y.mean(axis=1, keepdims=True)
    n = len(X)
    D = np.linalg.svd(np.einsum("tni,nj->tij", y, x) / n, compute_uv=False)
    spread = max(float((x * x).sum()) / n, np.finfo(float).tiny)
    left = (y * y).sum(axis=(1, 2)) / n - D.sum(axis=1) ** 2 / spread
    return np.maximum(left, 0.0)
