"""How far two surfaces are apart: Hausdorff distance and maximum root mean square (MRMS)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import InputError
from meshmark.mesh.closest_points import ClosestPoints, sample_surface
from meshmark.mesh.geometry import lengths, surface_box
from meshmark.mesh.triangle_search import search_order


@dataclass(frozen=True)
class SurfaceDistance:
    """Distances between two surfaces, both ways.

    Parameters
    ----------
    hausdorff : float
        Largest distance from a point of either surface to the other.
    mrms : float
        Root of the area-weighted mean squared distance, the larger of the two directions.
    mrms_error : float
        Standard error of `mrms`, as if the samples were drawn independently; they are spread over
        the surface, and err by less.
    diagonal : float
        Diagonal of the first surface's bounding box, to which both are put in relation.
    """

    hausdorff: float
    mrms: float
    mrms_error: float
    diagonal: float


def surface_distance(
    V0: FloatArray,
    F0: IntArray,
    V1: FloatArray,
    F1: IntArray,
    *,
    samples: int | None = None,
    seed: int = 0,
    order: IntArray | None = None,
) -> SurfaceDistance:
    """Measure how far two surfaces are apart.

    Parameters
    ----------
    V0, V1 : (N, 3), (M, 3) float64
        Vertex positions; those of the original first.
    F0, F1 : (F, 3), (G, 3) int
        Triangles; their numbers may differ.
    samples : int, optional
        Points spread over each surface, in proportion to area. By default one a face, and at
        least 10,000: the mean distance then repeats to about one per cent.
    seed : int
        Seed of the places of the samples.
    order : (F,) int, optional
        The `search_order` of the first surface's triangles, in any pose.

    Returns
    -------
    SurfaceDistance
        In the unit of the points.

    Raises
    ------
    InputError
        If a mesh has no face, or no extent.

    Notes
    -----
    Every vertex is a sample for the Hausdorff distance too, since that is where a piecewise
    linear surface has its extremes; the mean is over the area-weighted samples only. Identical
    meshes give about 1e-8 of the diagonal or less (see `ClosestPoints`).

    References
    ----------
    P. Cignoni, C. Rocchini, R. Scopigno, "Metro: measuring error on simplified surfaces",
    Computer Graphics Forum 17(2), 1998, doi:10.1111/1467-8659.00236.
    """
    # Points that no face uses are no part of the surface.
    diagonal, centre = surface_box(V0, F0)
    if not diagonal > 0 or not len(F1):
        raise InputError("a mesh without faces or without extent has no surface to compare")
    # One frame for both, so that nothing is lost to single precision far from the origin.
    A, B = (V0 - centre) / diagonal, (V1 - centre) / diagonal
    # Where the faces are the same, a vertex is no farther from the other surface than it moved.
    is_same = _same(F0, F1)
    moved = lengths(B - A) if is_same and len(A) == len(B) else None
    order = search_order(A, F0) if order is None else order
    rng = np.random.default_rng(seed)
    there = _one_sided(A, F0, ClosestPoints(B, F1, order if is_same else None), samples, rng, moved)
    back = _one_sided(B, F1, ClosestPoints(A, F0, order), samples, rng, moved)
    mrms, error = max(there[1:], back[1:])
    return SurfaceDistance(
        hausdorff=diagonal * max(there[0], back[0]),
        mrms=diagonal * mrms,
        mrms_error=diagonal * error,
        diagonal=diagonal,
    )


def default_samples(n_faces: int) -> int:
    """Return how many points are spread over a surface of so many triangles."""
    return max(10_000, n_faces)


def hausdorff(V0: FloatArray, F0: IntArray, V1: FloatArray, F1: IntArray) -> float:
    """Measure the symmetric Hausdorff distance; see `surface_distance`."""
    return surface_distance(V0, F0, V1, F1).hausdorff


def mrms(V0: FloatArray, F0: IntArray, V1: FloatArray, F1: IntArray) -> float:
    """Measure the maximum root mean square distance; see `surface_distance`."""
    return surface_distance(V0, F0, V1, F1).mrms


def _one_sided(
    V: FloatArray,
    F: IntArray,
    other: ClosestPoints,
    samples: int | None,
    rng: np.random.Generator,
    moved: FloatArray | None,
) -> tuple[float, float, float]:
    """Measure the largest distance from the surface (V, F) to another, the RMS, and its error.

    Parameters
    ----------
    moved : (N,) float64 or None
        What the distances of the vertices V are not beyond.
    """
    n = default_samples(len(F)) if samples is None else samples
    d = other.distances(sample_surface(V, F, n, rng))
    farthest = float(d.max())
    corner = np.zeros(len(V), dtype=bool)
    corner[F.ravel()] = True
    if moved is not None:
        corner &= moved > farthest
    if corner.any():
        farthest = max(farthest, float(other.distances(V[corner]).max()))
    square = d**2
    rms = float(np.sqrt(np.mean(square)))
    # The root of a mean m errs by the error of m over 2 sqrt(m).
    error = float(np.std(square)) / np.sqrt(n) / (2.0 * rms) if rms > 0.0 else 0.0
    return farthest, rms, float(error)


def _same(F: IntArray, G: IntArray) -> bool:
    return F is G or np.array_equal(F, G)
