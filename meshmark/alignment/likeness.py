"""How alike a copy, or a part of one, and an original are at a glance, before they are aligned.

Points of the copy are matched with those of the original about which the surface is alike. Where
something was cut off, what is left matches still: so the best of the matches count, and that the
distances between them are the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshmark.alignment.neighbourhoods import neighbourhoods
from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.closest_points import surface_samples
from meshmark.mesh.frame_range import spread
from meshmark.mesh.geometry import area_vectors, face_areas, normalized

# Points that a surface is measured by; every n-th of an original's is matched, and of a copy's.
SAMPLES, ORIGINALS, COPIES = 2400, slice(0, None, 5), slice(0, None, 10)
# Share of the original's area that a copy may be.
SHARES = tuple(0.87**step for step in range(-1, 8))
# Meshes and frames of an asset that are looked at: the largest, and some of each.
MESHES, FRAMES = 8, 4
# Matches that count, the best; distances beyond which they are compared, and how alike they are.
KEPT, FAR, STRETCH, BLUR = 0.4, 0.15, 0.12, 0.02


@dataclass(frozen=True, eq=False)
class Signature:
    """Points of a surface, and what it is like about them.

    Parameters
    ----------
    places : (n, 3) float32
        In roots of the area of the surface that it is taken for.
    shapes : (n, k) float32
        See `meshmark.alignment.neighbourhoods`.
    """

    places: NDArray[np.float32]
    shapes: NDArray[np.float32]


def signature(V: FloatArray, F: IntArray, chosen: slice, share: float = 1.0) -> Signature | None:
    """Measure a surface, whatever the similarity and the mesh.

    Parameters
    ----------
    V : (N, 3) float64
    F : (F, 3) int
    chosen : slice
        Which of the samples.
    share : float
        The share that it is taken for of the area of a whole, which is the unit.

    Returns
    -------
    Signature or None
        None for a surface without area.
    """
    total = float(face_areas(V, F).sum())
    if not 0.0 < total < np.inf:
        return None
    unit = np.sqrt(total / share)
    face, weights = surface_samples(V, F, SAMPLES, np.random.default_rng(0))
    P = np.einsum("ij,ijk->ik", weights, V[F[face]])
    P = (P - P.mean(axis=0)) / unit
    N = normalized(area_vectors(V, F[face]))
    # Normals point outwards, also of a mirror image.
    N *= 1.0 if (P * N).sum() >= 0.0 else -1.0
    return Signature(P[chosen].astype(np.float32), neighbourhoods(P, N, share, chosen))


def signatures(original: Asset) -> list[list[Signature]]:
    """Measure some frames of the largest meshes of an original."""
    meshes = _largest(original, MESHES)
    n = max(1, FRAMES // len(meshes))
    return [_signatures(mesh, spread(len(mesh), n), ORIGINALS, [1.0]) for mesh in meshes]


def hypotheses(copy: Asset) -> list[list[Signature]]:
    """Measure some frames of the largest meshes of a copy, as if they were parts of any size."""
    meshes = _largest(copy, MESHES // 2)
    n = max(2, FRAMES // len(meshes))
    # Every other frame of those that an original would have.
    return [_signatures(mesh, spread(len(mesh), n)[::2], COPIES, SHARES) for mesh in meshes]


def unlikeness(
    copy: Sequence[Sequence[Signature]], original: Sequence[Sequence[Signature]]
) -> float:
    """Compare a copy's hypotheses with an original's signatures.

    Returns
    -------
    float
        0 if every mesh of the copy is a part of one of the original, of the very same points;
        infinite if there is nothing to compare. Of each mesh of the copy, that frame and mesh
        of the original, and that hypothesis, counts that it is most like.
    """
    theirs = [each for mesh in original for each in mesh]
    each = [min(_distances(mine, theirs), default=np.inf) for mine in copy]
    return float(np.mean(each)) if each else np.inf


def _largest(asset: Asset, n: int) -> list[MeshAnimation]:
    """List the meshes of most points, in the order of the asset."""
    sizes = [mesh[0].topology.n_points for mesh in asset.meshes]
    kept = np.argsort([-size for size in sizes], kind="stable")[:n]
    return [asset.meshes[index] for index in sorted(kept.tolist())]


def _signatures(
    mesh: MeshAnimation, frames: Sequence[int], chosen: slice, shares: Sequence[float]
) -> list[Signature]:
    found = []
    for index in frames:
        frame = mesh[index]
        found += [signature(frame.points, frame.faces, chosen, share) for share in shares]
    return [each for each in found if each is not None]


def _distances(mine: Sequence[Signature], theirs: Sequence[Signature]) -> list[float]:
    return [_distance(one, two) for one in mine for two in theirs]


def _distance(copy: Signature, original: Signature) -> float:
    """Tell how unlike matched points are, times the share of matches that do not fit together."""
    unit = copy.shapes.std(axis=0) + 1e-6
    A, B = copy.shapes / unit, original.shapes / unit
    squares = (B**2).sum(axis=1) - 2.0 * A @ B.T
    match = squares.argmin(axis=1)
    off = np.sqrt(((A - B[match]) ** 2).sum(axis=1))
    best = np.argsort(off, kind="stable")[: int(KEPT * len(off))]
    own, other = (_between(X) for X in (copy.places[best], original.places[match[best]]))
    far = own > FAR
    fit = np.abs(own - other)[far] < STRETCH * own[far] + BLUR
    return float(off[best].mean()) * (1.0 - float(fit.mean()) if far.any() else 1.0)


def _between(X: NDArray[np.float32]) -> NDArray[np.float32]:
    """Compute the distances of points from each other, (n, n)."""
    squares = (X**2).sum(axis=1)
    return np.sqrt(np.maximum(squares[:, None] + squares - 2.0 * X @ X.T, 0.0))
