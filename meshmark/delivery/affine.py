"""Affine maps of points, (x, y, z, 1) times a matrix (4, c), and frames that go with them."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray

# The centre of a cloud (3,), and three axes (3, 3).
Frame = tuple[FloatArray, FloatArray]
# Sums of squares of larger numbers leave the range of double precision.
LARGEST = 1e140


def computable(values: FloatArray) -> bool:
    """Tell whether all values are finite, and small enough for sums of their squares."""
    # False for what is not a number, too.
    return bool((np.abs(values) <= LARGEST).all())


def fit(P: FloatArray, X: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Fit X (m, c) by an affine map of P (m, 3); the map (4, c), residuals of columns (c,)."""
    centre, middle = P.mean(axis=0), X.mean(axis=0)
    linear = np.linalg.lstsq(P - centre, X - middle, rcond=1e-9)[0]
    matrix = np.vstack([linear, middle - centre @ linear])
    off = np.sqrt(np.mean((X - with_ones(P) @ matrix) ** 2, axis=0))
    return matrix, off


def with_ones(points: FloatArray) -> FloatArray:
    """Append a 1 to every point (N, 3), (N, 4)."""
    return np.column_stack([points, np.ones(len(points))])


def inverse(matrix: FloatArray) -> FloatArray:
    """Invert a map (4, 3), as far as it can be."""
    linear = np.linalg.pinv(matrix[:3], rcond=1e-9)
    return np.vstack([linear, -matrix[3] @ linear])


def relative(off: FloatArray, matrix: FloatArray, diagonal: FloatArray | float) -> FloatArray:
    """Say of residuals of columns how large they are in the shape's own space."""
    gain = np.linalg.norm(matrix, axis=-2)
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = off / (gain * diagonal)
    return np.where(np.isfinite(relative), relative, np.inf)


def frames_of(cloud: FloatArray) -> list[Frame]:
    """Return frames that go with a cloud: its centre (3,), and axes (3, 3) with their lengths.

    Those of its box, of its principal axes, and of its moments up to the fifth, which go with it
    through any affine map.
    """
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    centre = cloud.mean(axis=0)
    X = cloud - centre
    values, axes = np.linalg.eigh(X.T @ X / len(X))
    size = np.sqrt(values.clip(min=1e-18 * max(values.max(), 1e-300)))
    Y = X @ axes / size
    square = np.sum(Y**2, axis=1, keepdims=True)
    first, second = np.mean(square * Y, axis=0), np.mean(square**2 * Y, axis=0)
    turn = np.linalg.qr(np.stack([first, second, np.cross(first, second)], axis=1))[0]
    turn *= np.where(np.sum(turn * np.stack([first, second, first], axis=1), axis=0) < 0, -1, 1)
    return [
        ((low + high) / 2, np.diag(high - low)),
        (centre, axes.T * np.sqrt((size**2).mean())),
        (centre, turn.T @ np.diag(size) @ axes.T),
    ]
