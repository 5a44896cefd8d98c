"""The maps of a placed frame: its similarity, and least squares on top of it."""

from __future__ import annotations

import numpy as np

from meshmark.alignment.matching import Matcher
from meshmark.alignment.placement import TERMS, PolynomialMap, monomials
from meshmark.alignment.refinement import Placement
from meshmark.alignment.robust import scale_of, tukey
from meshmark.arrays import FloatArray
from meshmark.mesh.geometry import lengths

ROUNDS = 20
# Weights reject by so many times the scale at first: what bends away is to be followed, too.
WIDE, NARROWING = 6.0, 0.7
# Distances of most vertices below which there is nothing to follow.
EXACTLY = 1e-6
# Pull towards the similarity, as a share of the mean curvature of the squares.
RIDGE = 1e-6
# A cubic has sixty numbers: on a remnant it would follow the mark.
CUBIC_COVERS = 0.5
# Steps that are smaller, or this share of the distances, are the last.
EXACT, CHANCE = 1e-7, 2e-3


def maps_of(
    P: FloatArray, placement: Placement, matcher: Matcher, covered: float
) -> dict[str, PolynomialMap]:
    """Fit the maps of a frame.

    Parameters
    ----------
    P : (n, 3) float64
        Vertices of the copy.
    placement : Placement
        Converged.
    matcher : Matcher
        Of its pose.
    covered : float
        Share of the original's area.
    """
    start = similarity_of(P, placement)
    found = {"similarity": start, "affine": _fit(P, start, matcher, 1)}
    if covered >= CUBIC_COVERS and len(P) > 10 * TERMS[3]:
        found["cubic"] = _fit(P, found["affine"], matcher, 3)
    return found


def similarity_of(P: FloatArray, placement: Placement) -> PolynomialMap:
    """Return the map of a placement itself, for vertices P (n, 3)."""
    centre = P.mean(axis=0)
    size = float(np.abs(P - centre).max()) or 1.0
    return PolynomialMap.affine(placement.A[:, :3], placement.A[:, 3], centre, size)


def _fit(P: FloatArray, start: PolynomialMap, matcher: Matcher, degree: int) -> PolynomialMap:
    """Move the map's coefficients until most vertices are nearest to the surface."""
    basis = monomials((P - start.centre) / start.size, degree)
    C = np.zeros((TERMS[degree], 3))
    C[: len(start.coefficients)] = start.coefficients
    unit = float(np.linalg.norm(C[1:4]))
    width = WIDE
    for _ in range(ROUNDS):
        X = basis @ C
        match = matcher.match(X)
        gap = (X - match.points) / unit
        distance = lengths(gap)
        scale = max(scale_of(distance), EXACT)
        width = 1.0 if scale < EXACTLY else max(1.0, width)
        w = tukey(distance, width * scale)
        step = _step(basis, gap, match.normals, w, match.slip(gap))
        C = C + unit * step
        if width == 1.0 and np.abs(step).max() < max(EXACT, CHANCE * scale):
            break
        width *= NARROWING
    return PolynomialMap(C, start.centre, start.size)


def _step(
    basis: FloatArray, gap: FloatArray, n: FloatArray, w: FloatArray, slip: float
) -> FloatArray:
    k = basis.shape[1]
    J = (basis[:, :, None] * n[:, None, :]).reshape(len(basis), -1)
    H = (J * w[:, None]).T @ J
    g = J.T @ (w * (gap * n).sum(axis=1))
    if slip > 0:
        everywhere = np.kron((basis * w[:, None]).T @ basis, np.eye(3))
        H = (1 - slip) * H + slip * everywhere
        g = (1 - slip) * g + slip * (basis.T @ (gap * w[:, None])).ravel()
    H[np.diag_indices_from(H)] += RIDGE * float(np.trace(H)) / len(H)
    step: FloatArray = -np.linalg.solve(H, g).reshape(k, 3)
    return step
