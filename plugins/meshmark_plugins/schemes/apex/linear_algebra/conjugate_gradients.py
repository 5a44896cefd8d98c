"""Conjugate gradients for operators that are cheap to apply and well preconditioned."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from meshmark.arrays import FloatArray


def conjugate_gradients(
    A: Any,
    b: FloatArray,
    x: FloatArray,
    preconditioner: FloatArray | Callable[[FloatArray], FloatArray],
    iterations: int,
    tolerance: float,
) -> FloatArray:
    """Solve A x = b approximately.

    Parameters
    ----------
    A : object with ``@``
        Symmetric positive definite, (n, n).
    b, x : (n,) float64
        Right-hand side and first guess.
    preconditioner : (n,) float64 or callable
        Inverse of the diagonal, or a function that applies some symmetric approximate inverse.
    iterations : int
        Most steps.
    tolerance : float
        Stop when the preconditioned residual has shrunk by this factor.

    Notes
    -----
    scipy's solver counts residuals without the preconditioner, in whose norm alone they shrink
    steadily; here a handful of steps must do.
    """
    apply = preconditioner if callable(preconditioner) else lambda r: preconditioner * r
    r = b - A @ x if x.any() else b
    z = apply(r)
    p = z
    rz = float(r @ z)
    enough = tolerance**2 * rz
    for _ in range(iterations):
        if rz <= enough:
            break
        Ap = A @ p
        step = rz / float(p @ Ap)
        x = x + step * p
        r = r - step * Ap
        z = apply(r)
        rz, before = float(r @ z), rz
        p = z + (rz / before) * p
    return x
