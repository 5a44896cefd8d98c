"""What the surface is like about some of its points: it stays where the rest is cut away."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray
from meshmark.mesh.geometry import lengths

# Radii of the balls about a point.
RADII = (0.08, 0.15, 0.25)
# Rows and columns of the upper triangle of a symmetric matrix.
_I, _J = np.triu_indices(3)


def neighbourhoods(
    P: FloatArray, N: FloatArray, area: float, centres: slice
) -> NDArray[np.float32]:
    """Measure a surface within balls about some of its points.

    Parameters
    ----------
    P : (n, 3) float64
        Points that are spread evenly over the surface.
    N : (n, 3) float64
        Unit normals there.
    area : float
        Of the surface, in the unit in which `RADII` are lengths.
    centres : slice
        Which points.

    Returns
    -------
    (m, 36) float32
        For each radius 12 numbers that no rotation changes: the area within the ball, beside that
        of a disk; how far its centroid lies above the tangent plane, and along it; the standard
        deviations of its points, and of its normals, along their principal axes; the length of the
        mean normal, and its part along the normal of the centre; and the mean of the points along
        their own normals.

    Notes
    -----
    They are integrals over the surface, which noise and another mesh change little: see [1]_.

    References
    ----------
    .. [1] H. Pottmann, J. Wallner, Q.-X. Huang, Y.-L. Yang, "Integral invariants for robust
       geometry processing", Computer Aided Geometric Design 26(1), 2009,
       doi:10.1016/j.cagd.2008.01.002.
    """
    X, normals = P[centres], N[centres]
    along = (P * N).sum(axis=1, keepdims=True)
    squares = [A[:, _I] * A[:, _J] for A in (P, N)]
    summed = np.hstack([np.ones((len(P), 1)), P, squares[0], N, squares[1], along])
    distances = (X**2).sum(axis=1)[:, None] + (P**2).sum(axis=1) - 2.0 * X @ P.T
    measured = []
    for radius in RADII:
        # A point is in its own ball, whatever is rounded.
        within = distances <= radius**2
        within[np.arange(len(X)), np.arange(len(P))[centres]] = True
        sums = within.astype(np.float64) @ summed
        count = sums[:, :1]
        mean = sums / count
        to_centroid = (mean[:, 1:4] - X) / radius
        above = (to_centroid * normals).sum(axis=1)
        beside = np.sqrt(np.maximum((to_centroid**2).sum(axis=1) - above**2, 0.0))
        normal = mean[:, 10:13]
        measured += [
            count[:, 0] * area / len(P) / (np.pi * radius**2),
            above,
            beside,
            *(_deviations(mean[:, 4:10], mean[:, 1:4]) / radius).T,
            *_deviations(mean[:, 13:19], normal).T,
            lengths(normal),
            (normal * normals).sum(axis=1),
            (mean[:, 19] - (X * normal).sum(axis=1)) / radius,
        ]
    return np.stack(measured, axis=1).astype(np.float32)


def _deviations(squares: FloatArray, mean: FloatArray) -> FloatArray:
    """Return standard deviations along principal axes, (m, 3), from second and first moments."""
    C = np.empty((len(mean), 3, 3))
    C[:, _I, _J] = C[:, _J, _I] = squares - mean[:, _I] * mean[:, _J]
    return np.sqrt(np.maximum(np.linalg.eigvalsh(C), 0.0))
