"""Noise as smooth as a relief: what others lay upon a surface, and what smoothing leaves."""

from __future__ import annotations

import numpy as np
from scipy.sparse import diags_array

from meshmark.arrays import FloatArray
from meshmark_plugins.schemes.relief.basis import Smoother
from meshmark_plugins.schemes.relief.inverse import Inverse

# Variance that is left to single vertices, as a share of the smooth one.
ROUGH = 0.1
# Random fields by which the mean variance is found out.
PROBES = 16


class SmoothNoise:
    """A random field, of mean variance 1 + ROUGH.

    With the masses M and the matrix A = M + t L of a smoother, its covariance is that of white
    noise, smoothed, and of some more that is not: C = b A^-1 M A^-1 + a M^-1. In the eigenvectors
    of L, M C has the eigenvalues b / y^2 + a, those of A being y in M. So M^-1 C^-1 has
    (1 - 1 / (1 + a/b y^2)) / a, and 1 / (1 + e^2 y^2) is the real part of 1 / (1 + i e y):
    C^-1 = (M - M Re[(M + i e A)^-1] M) / a with e^2 = a/b.

    Parameters
    ----------
    smoother : Smoother
        Of N vertices.
    """

    def __init__(self, smoother: Smoother) -> None:
        self._mass = M = smoother.mass
        probes = np.random.default_rng(0).choice((-1.0, 1.0), (len(M), PROBES))
        smooth = smoother((probes.T / np.sqrt(M)).T)
        b = 1.0 / float(np.average(smooth**2, axis=0, weights=M).mean())
        self._white = ROUGH * float(M.mean())
        e = np.sqrt(self._white / b)
        self._inverse = Inverse(diags_array(M) + 1j * e * smoother.matrix, smoother.space)

    def precision(self, x: FloatArray) -> FloatArray:
        """Apply C^-1 to x (N, n)."""
        Mx = self._mass[:, None] * x
        smooth = self._inverse(Mx.astype(np.complex128)).real
        return (Mx - self._mass[:, None] * smooth) / self._white
