"""Undoes what may have been done to a copy: smoothing is linear, and its operator is known.

Whether a copy was smoothed, and how often, is a hypothesis like any other: every one that is
tried costs belief, and none needs the key.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev
from scipy.sparse import csr_matrix, eye_array

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


def unsmoothed(frame: Frame, counts: Sequence[int]) -> tuple[Frame, ...]:
    """Undo umbrella smoothing, as far as noise allows; for each of several amounts.

    Parameters
    ----------
    frame : Frame
        A frame, on the connectivity it was smoothed with.
    counts : sequence of int
        How often it may have been smoothed; for 0, it is the frame itself.

    Notes
    -----
    With S = 1 + lambda L the smoothing step, X <- X + (V - S^n X), repeated from X = V, undoes
    n steps as a regularised inverse does: it is a polynomial in L. Here all of them are evaluated
    by their series in the same Chebyshev polynomials, which takes some thirty applications of L
    instead of `STEPS` n for each.
    """
    wanted = tuple(dict.fromkeys(n for n in counts if n))
    points = {}
    if wanted:
        L = polygon_umbrella(frame.topology)
        points = dict(zip(wanted, _series(L, frame.points, wanted), strict=True))
    return tuple(frame.moved(points[n]) if n else frame for n in counts)


@lru_cache(maxsize=16)
def _coefficients(iterations: int) -> FloatArray:
    nodes = chebyshev.chebpts1(DEGREE + 1)
    smoothed = (1.0 - LAMBDA * HIGHEST * (nodes + 1.0) / 2.0) ** iterations
    gain = (1.0 - (1.0 - smoothed) ** (STEPS + 1)) / smoothed
    return np.asarray(chebyshev.chebfit(nodes, gain, DEGREE), dtype=np.float64)


def _series(L: csr_matrix, V: FloatArray, counts: Sequence[int]) -> list[FloatArray]:
    """Evaluate Chebyshev series in the operator -L, scaled from [0, `HIGHEST`] to [-1, 1]."""
    A = csr_matrix(-(2.0 / HIGHEST) * L - eye_array(len(V)))
    coefficients = np.array([_coefficients(n) for n in counts])
    sums = [c * V for c in coefficients[:, 0]]
    before, term = V, A @ V
    for k in range(1, DEGREE + 1):
        for total, c in zip(sums, coefficients[:, k].tolist(), strict=True):
            total += c * term
        if k < DEGREE:
            before, term = term, 2.0 * (A @ term) - before
    return sums
