"""The segmenter: diameters, two levels of thickness, one cut between them, and its parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import UsageError
from meshmark.extension.parameters import require_number, require_whole
from meshmark.mesh.checks import mesh_arrays
from meshmark_plugins.segmenters.sdf.creases import cut_costs
from meshmark_plugins.segmenters.sdf.cut import expand
from meshmark_plugins.segmenters.sdf.diameter import shape_diameter
from meshmark_plugins.segmenters.sdf.dual import DualGraph
from meshmark_plugins.segmenters.sdf.mixture import Mixture
from meshmark_plugins.segmenters.sdf.parts import parts_of
from meshmark_plugins.segmenters.sdf.smoothing import diffuse

NAME = "segmenter sdf"

DIFFUSION_TIME = 4e-4
"""Values blur over 2.8 % of sqrt(area): more than a noisy face, less than a limb."""

LOG_GAIN = 4.0
"""Contrast of log-normalised diameters, as published: thin parts get more of the range."""

LEAST_PROBABILITY = 1e-3
"""No face is so sure of its cluster that its neighbours cannot outvote it."""


@dataclass(frozen=True)
class SDFSegmenter:
    """Cuts a mesh where its thickness changes, after Shapira, Shamir and Cohen-Or [1]_.

    Parameters
    ----------
    cone_angle : float
        Opening angle of the cone of rays in degrees.
    rays : int
        Rays of a face; see `shape_diameter`.
    clusters : int
        Levels of thickness ("partition level"): Gaussians fitted to the diameters.
    smoothness : float
        Price of a cut as long as the side of a square with the mesh's area. Between 0.05 and
        0.3 little changes; far above, thin limbs join what they hang on.
    min_area : float
        Share of the area below which a part joins a neighbour.
    covariance : str
        "tied": one standard deviation for all clusters, so that the limit between two lies
        midway, where thickness changes fastest and the cut repeats best. "full": one for each.

    Raises
    ------
    UsageError
        If a parameter is out of range.

    Notes
    -----
    Area weighs the data and length weighs the cuts, both against the mesh's own area, so the
    energy that is minimised is that of the surface, whatever its triangles are.

    References
    ----------
    .. [1] L. Shapira, A. Shamir, D. Cohen-Or, "Consistent mesh partitioning and skeletonisation
       using the shape diameter function", The Visual Computer 24 (2008).
       doi:10.1007/s00371-007-0197-5

    Examples
    --------
    >>> from meshmark.testing.meshes import dumbbell
    >>> labels = SDFSegmenter().segment(*dumbbell())
    >>> int(labels.max()) + 1
    3
    """

    cone_angle: float = 120.0
    rays: int = 25
    clusters: int = 2
    smoothness: float = 0.1
    min_area: float = 0.01
    covariance: str = "tied"

    def __post_init__(self) -> None:
        require_number(NAME, "cone_angle", self.cone_angle, 0.0, 180.0)
        require_whole(NAME, "rays", self.rays, 1, 10_000)
        require_whole(NAME, "clusters", self.clusters, 1, 16)
        require_number(NAME, "smoothness", self.smoothness, 0.0, 1e6, low_allowed=True)
        require_number(NAME, "min_area", self.min_area, 0.0, 1.0, low_allowed=True)
        if self.covariance not in ("tied", "full"):
            raise UsageError(f"{NAME}: covariance must be tied or full, not {self.covariance!r}")

    def segment(self, V: ArrayLike, F: ArrayLike) -> IntArray:
        """Label each face with its part.

        Parameters
        ----------
        V : (N, 3) array_like of float
            Vertex positions.
        F : (F, 3) array_like of int
            Triangles.

        Returns
        -------
        (F,) int64
            Part of each face; parts are edge-connected and numbered by decreasing area.

        Raises
        ------
        InputError
            If the arrays are not those of a mesh.
        """
        points, faces = mesh_arrays(V, F)
        dual = DualGraph.of(points, faces)
        diameter = shape_diameter(points, faces, cone_angle=self.cone_angle, rays=self.rays)
        level = _levels(diameter, dual.area)
        smooth = diffuse(np.column_stack([level, dual.normal]), dual, DIFFUSION_TIME)
        labels = self._labels(np.clip(smooth[:, 0], 0.0, 1.0), smooth[:, 1:], dual)
        return parts_of(labels, faces, dual, self.min_area)

    def _labels(self, level: FloatArray, normal: FloatArray, dual: DualGraph) -> IntArray:
        mixture = Mixture.fit(level, dual.area, self.clusters, tied=self.covariance == "tied")
        posterior = np.maximum(mixture.log_posterior(level), np.log(LEAST_PROBABILITY))
        price = cut_costs(normal, dual, np.sqrt(DIFFUSION_TIME))
        return expand(-dual.area[:, None] * posterior, dual.pairs, self.smoothness * price)


def _levels(diameter: FloatArray, area: FloatArray) -> FloatArray:
    """Log-normalise diameters to [0, 1], (F,), with unmeasured components at the median."""
    measured = ~np.isnan(diameter)
    if not measured.any():
        return np.zeros(len(diameter))
    filled = np.where(measured, diameter, _quantile(diameter[measured], area[measured], 0.5))
    # The largest value is one face's; all but 1 % of the area repeats.
    top = _quantile(filled, area, 0.99)
    share = np.clip(filled / top, 0.0, 1.0) if top > 0.0 else np.zeros(len(filled))
    return np.log1p(LOG_GAIN * share) / np.log1p(LOG_GAIN)


def _quantile(x: FloatArray, weight: FloatArray, q: float) -> float:
    order = np.argsort(x, kind="stable")
    reached = np.cumsum(weight[order])
    if reached[-1] <= 0.0:
        return float(np.quantile(x, q))
    return float(np.interp(q * reached[-1], reached, x[order]))
