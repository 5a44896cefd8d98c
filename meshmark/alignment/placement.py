"""What an alignment says: the pose and the maps of each frame of a copy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import LeftOut

# Exponents of x, y and z, by degree: 1; x, y, z; then the six squares and the ten cubes.
EXPONENTS = np.array(
    [(i, j, d - i - j) for d in range(4) for i in range(d, -1, -1) for j in range(d - i, -1, -1)]
)
TERMS = {1: 4, 3: 20}


@dataclass(frozen=True, eq=False)
class PolynomialMap:
    """A map of space whose coordinates are polynomials of the point's.

    Parameters
    ----------
    coefficients : (4, 3) or (20, 3) float64
        Of the monomials of degree at most 1 or 3 in (p - centre) / size; see `monomials`.
    centre : (3,) float64
    size : float
        Both in the unit of the points that are mapped.
    """

    coefficients: FloatArray
    centre: FloatArray
    size: float

    @classmethod
    def affine(cls, A: FloatArray, b: FloatArray, centre: FloatArray, size: float) -> PolynomialMap:
        """Build the map p -> A p + b."""
        return cls(np.vstack([A @ centre + b, size * A.T]), centre, size)

    def __call__(self, P: FloatArray) -> FloatArray:
        """Map points, (n, 3) -> (n, 3)."""
        return monomials((P - self.centre) / self.size, self.degree) @ self.coefficients

    @property
    def degree(self) -> int:
        """1 or 3."""
        return next(d for d, terms in TERMS.items() if terms == len(self.coefficients))

    @property
    def matrix(self) -> FloatArray:
        """The map p -> A p + b of degree 1 as [A b], (3, 4).

        Raises
        ------
        ValueError
            If the degree is not 1.
        """
        if self.degree != 1:
            raise ValueError("only a map of degree 1 is a matrix")
        A = self.coefficients[1:].T / self.size
        return np.column_stack([A, self.coefficients[0] - A @ self.centre])


def monomials(U: FloatArray, degree: int) -> FloatArray:
    """Compute the monomials of degree at most 1 or 3, (n, 4) or (n, 20).

    Parameters
    ----------
    U : (n, 3) float64
        Coordinates, best within [-1, 1].
    """
    powers = np.stack([np.ones_like(U), U, U**2, U**3])
    i, j, k = EXPONENTS[: TERMS[degree]].T
    columns: FloatArray = powers[i, :, 0] * powers[j, :, 1] * powers[k, :, 2]
    return columns.T


@dataclass(frozen=True, eq=False)
class FramePlacement:
    """Where one frame of a copy lies on its original.

    Parameters
    ----------
    index : int
        Frame of the copy.
    pose : float
        Frame of the original it shows; between two, a linear blend of them. See
        `meshmark.alignment.poses.posed`. The nearest frame, where the original never takes the
        pose.
    maps : mapping of str to PolynomialMap
        From the copy's world space to the original's. "similarity" (mirrors included) always,
        "affine" too, and "cubic" where enough of the surface is covered; neither of them where
        the original never takes the pose.
    residual : float
        Root mean square distance of the copy's vertices from the posed (or reposed) original
        under the similarity, the farthest tenth left aside; a share of the original's diagonal.
    covered : float
        Share of the original's area that has vertices of the copy within reach.
    """

    index: int
    pose: float
    maps: Mapping[str, PolynomialMap]
    residual: float
    covered: float


@dataclass(frozen=True, eq=False)
class MeshAlignment:
    """Where a copy of one mesh lies on it.

    Parameters
    ----------
    copy : tuple of MeshAnimation
        The meshes of the copy that lie on it: one, or several into which it was split; or pieces of
        a mesh that several were joined to.
    original : MeshAnimation
    method : {"identity", "reposed", "pca", "features"}
        How it was found. "identity": vertex i of the copy is vertex i of the original.
        "reposed": so it is, in poses that the original never takes.
    frames : tuple of FramePlacement
        Those frames of the copy that could be placed, in order.
    """

    copy: tuple[MeshAnimation, ...]
    original: MeshAnimation
    method: str
    frames: tuple[FramePlacement, ...]

    @property
    def prims(self) -> tuple[str, ...]:
        """The meshes of the copy's file that lie on it, or pieces of them."""
        return tuple(dict.fromkeys(mesh.prim for mesh in self.copy))

    @property
    def residual(self) -> float:
        """Median over the frames."""
        return float(np.median([frame.residual for frame in self.frames]))

    @property
    def covered(self) -> float:
        """Median over the frames."""
        return float(np.median([frame.covered for frame in self.frames]))


@dataclass(frozen=True, eq=False)
class AssetAlignment:
    """Where the meshes of a copy lie on those of the original.

    Parameters
    ----------
    meshes : tuple of MeshAlignment
        One for each mesh of the original that was found in the copy.
    unplaced : tuple of LeftOut
        Meshes of the original that were not found, and why.
    """

    meshes: tuple[MeshAlignment, ...]
    unplaced: tuple[LeftOut, ...] = ()
