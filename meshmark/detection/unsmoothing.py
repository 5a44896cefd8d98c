"""Undoes what may have been done to a copy: smoothing is linear, and its operator is known.

Whether a copy was smoothed, and how often, is a hypothesis like any other: every one that is
tried costs belief, and none needs the key.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev
from scipy.sparse import csr_matrix

from meshmark.arrays import FloatArray
from meshmark.mesh.animation import Frame
from meshmark.mesh.smoothing import LAMBDA, polygon_umbrella

# Landweber steps X += V - S^n X that the filter stands for. The more, the sharper the copy
# becomes, and its noise with it.
STEPS = 15
# Degree of the polynomial that replaces the steps; its error is below 1e-4 of the filter's
# range for every count of iterations in use.
DEGREE = 28
# The umbrella operator (mean of neighbours - V) has its eigenvalues between -2 and 0.
HIGHEST = 2.0


def unsmooth(frame: Frame, iterations: int) -> Frame:
    """Undo umbrella smoothing, as far as noise allows.

    Parameters
    ----------
    frame : Frame
        A frame, on the connectivity it was smoothed with.
    iterations : int
        How often it was smoothed; 0 returns the frame itself.

    Notes
    -----
    With S = 1 + lambda L the smoothing step, X <- X + (V - S^n X), repeated from X = V, undoes
    n steps as a regularised inverse does: it is a polynomial in L, here evaluated by its
    Chebyshev series, which takes some thirty applications of L instead of `STEPS` n.
    """
    if iterations == 0:
        return frame
    L = polygon_umbrella(frame.topology)
    return frame.moved(_clenshaw(L, frame.points, _coefficients(iterations)))


@lru_cache(maxsize=16)
def _coefficients(iterations: int) -> FloatArray:
    nodes = chebyshev.chebpts1(DEGREE + 1)
    smoothed = (1.0 - LAMBDA * HIGHEST * (nodes + 1.0) / 2.0) ** iterations
    gain = (1.0 - (1.0 - smoothed) ** (STEPS + 1)) / smoothed
    return np.asarray(chebyshev.chebfit(nodes, gain, DEGREE), dtype=np.float64)


def _clenshaw(L: csr_matrix, V: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Evaluate a Chebyshev series in the operator -L, scaled from [0, `HIGHEST`] to [-1, 1]."""
    later, latest = np.zeros_like(V), np.zeros_like(V)
    for c in coefficients[:0:-1]:
        later, latest = 2.0 * _scaled(L, later) - latest + c * V, later
    return _scaled(L, later) - latest + coefficients[0] * V


def _scaled(L: csr_matrix, X: FloatArray) -> FloatArray:
    return -(2.0 / HIGHEST) * (L @ X) - X
