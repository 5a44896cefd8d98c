"""Vertex norms, the distances from the centre of gravity, sorted into bins of equal width."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.extension.carrier import Carrier

# A bin narrower than this share of the largest norm holds one vertex, or rounding errors.
MIN_BIN_WIDTH = 1e-9


@dataclass(frozen=True, eq=False)
class NormBins(Carrier):
    """All vertices of a frame, binned by norm; fractions 0 and 1 are the bin's own extremes.

    Parameters
    ----------
    centre : (3,) float64
        Centre of gravity: the mean of the vertices.
    norm : (n,) float64
        Distance of each vertex from the centre.
    lower, width : (n_bins,) float64
        Smallest norm of each bin, and how far its largest is above it; 0 for an empty bin.
    """

    centre: FloatArray
    norm: FloatArray
    lower: FloatArray
    width: FloatArray


def bin_norms(V: FloatArray, n_bins: int) -> NormBins:
    """Sort vertices by norm into `n_bins` bins, of equal width from smallest to largest norm.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    n_bins : int
        Number of bins.

    Notes
    -----
    As in the paper, a bin's norms are normalised by the smallest and the largest norm that is
    in it, not by the bin's edges. These two stay where they are under the power map, so that
    the marked mesh is normalised as the original was. A bin whose vertices all have one norm
    holds nothing and is an erasure.
    """
    centre = V.mean(axis=0)
    norm = np.linalg.norm(V - centre, axis=1)
    low, high = norm.min(), norm.max()
    scale = n_bins / (high - low) if high > low else 0.0
    bins = np.clip(np.floor((norm - low) * scale), 0, n_bins - 1).astype(np.int64)
    lower, upper = np.full(n_bins, np.inf), np.full(n_bins, -np.inf)
    np.minimum.at(lower, bins, norm)
    np.maximum.at(upper, bins, norm)
    holds = upper - lower > MIN_BIN_WIDTH * high
    lower, width = np.where(holds, lower, 0.0), np.where(holds, upper - lower, 0.0)
    inside = holds[bins]
    fraction = np.divide(norm - lower[bins], width[bins], out=np.zeros(len(norm)), where=inside)
    return NormBins(
        vertices=np.arange(len(V)),
        bins=np.where(inside, bins, -1),
        bin_fraction=fraction,
        n_bins=n_bins,
        descriptor=np.array([low, high]) / norm.mean(),
        centre=centre,
        norm=norm,
        lower=lower,
        width=width,
    )
