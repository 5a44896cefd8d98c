"""Whether a copy's vertices stand where a recipient's copy has them, each by itself.

A copy may have been put together from several, each vertex from one of them: the lowest, the
highest, or any. Its heights then resemble those of each copy only a little. But at one vertex in
so many they are the very same.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.special import logsumexp

from meshmark.arrays import BoolArray, FloatArray, IntArray, SignArray
from meshmark_plugins.schemes.relief.basis import Basis
from meshmark_plugins.schemes.relief.blocks import Block
from meshmark_plugins.schemes.relief.chips import MAD_TO_SIGMA

# Share of its vertices that a copy is taken to have from the one in question.
SHARE = 0.1
# Noise is tried in these sizes, and heights are never less spread than this.
NOISES, LEAST_SPREAD = (0.01, 0.03, 0.1, 0.3), 0.1
# Neighbours tend to come from the same copy, and are low together: each counts for half.
WEIGHT = 0.5
# Likelihoods of a vertex that are computed at once: they then fit into a processor's cache.
AT_ONCE = 512


def log_fits(
    basis: Basis,
    blocks: Sequence[Block],
    owner: BoolArray,
    vertices: IntArray,
    y: FloatArray,
    signs: SignArray,
    decoys: SignArray,
) -> FloatArray:
    """Tell how well the chips of each block fit heights, given those of the blocks before it.

    Parameters
    ----------
    basis : Basis
        K chips.
    blocks : sequence of B Block
        Their heights at the vertices.
    owner : (K,) bool
        Chips that are the owner's in every copy.
    vertices : (V,) int
        Which vertices are looked at.
    y : (V,) float64
        Their heights in the copy, in heights of the relief; NaN where unknown.
    signs : (n, K) int
        Chips of n recipients.
    decoys : (M, K) int
        Chips drawn at random. They stand in for a recipient's in the block in question.

    Returns
    -------
    (B, n, 1 + M) float64
        Log likelihood with each block's own chips, then with the decoys'.

    Notes
    -----
    A height is that of the recipient's copy with probability `SHARE`, up to noise of one of the
    sizes `NOISES`, or else distributed like all heights, normally. Chips of large patches and the
    owner's are known beforehand; blocks still to come vary the recipient's height at random.
    """
    elsewhere = (1.0 - SHARE) * _density_of_all(y)
    x = basis.heights(_known_before(signs, blocks, owner).T)[vertices].astype(np.float32)
    fits, at_once = [], max(1, AT_ONCE // (1 + len(decoys)))
    for block, variance in zip(blocks, _variances(blocks, owner, len(y)), strict=True):
        free, rows = ~owner[block.chips], block.rows
        own, drawn = (
            block.heights[:, free] @ words[:, block.chips][:, free].T.astype(np.float32)
            for words in (signs, decoys)
        )
        seen = np.flatnonzero(~np.isnan(y[rows]))
        at = rows[seen]
        short = (y[at, None] - x[at]).astype(np.float32)
        fit = np.empty((len(signs), 1 + len(decoys)))
        for some in (slice(n, n + at_once) for n in range(0, len(signs), at_once)):
            off = np.empty((len(seen), fit[some].shape[0], fit.shape[1]), np.float32)
            off[:, :, 0] = short[:, some] - own[seen][:, some]
            np.subtract(short[:, some, None], drawn[seen][:, None, :], out=off[:, :, 1:])
            fit[some] = _log_fit(np.square(off, out=off), variance[seen], elsewhere[at])
        fits.append(fit)
        x[rows] += own
    return np.array(fits)


def _log_fit(square: FloatArray, variance: FloatArray, elsewhere: FloatArray) -> FloatArray:
    """Log likelihood (n, m) of R vertices that stand off by the root of square (R, n, m)."""
    rest = elsewhere[:, None, None].astype(np.float32)
    by_noise, p = [], np.empty_like(square)
    for noise in NOISES:
        v = (variance + noise**2)[:, None, None].astype(np.float32)
        np.exp(np.multiply(square, -0.5 / v, out=p), out=p)
        p *= SHARE / np.sqrt(2.0 * np.pi * v)
        p += rest
        by_noise.append(WEIGHT * np.log(p, out=p).sum(axis=0, dtype=np.float64))
    return logsumexp(by_noise, axis=0) - np.log(len(NOISES))


def _density_of_all(y: FloatArray) -> FloatArray:
    """Density of each height (V,) under a normal distribution with their median and spread."""
    known = y[~np.isnan(y)]
    centre = np.median(known)
    spread = max(MAD_TO_SIGMA * float(np.median(np.abs(known - centre))), LEAST_SPREAD)
    # Beyond three deviations tails are fatter.
    z = np.minimum(np.abs(y - centre) / spread, 3.0)
    return np.exp(-0.5 * z**2) / (np.sqrt(2.0 * np.pi) * spread)


def _known_before(signs: SignArray, blocks: Sequence[Block], owner: BoolArray) -> FloatArray:
    """Take out of chips (n, K) those that blocks are to tell."""
    told = np.zeros(len(owner), dtype=bool)
    for block in blocks:
        told[block.chips] = True
    return np.where(told & ~owner, 0.0, signs)


def _variances(blocks: Sequence[Block], owner: BoolArray, n_vertices: int) -> Iterator[FloatArray]:
    """Yield the variance (R,) that the blocks after each one add to its heights."""
    own = [(block.heights[:, ~owner[block.chips]] ** 2).sum(axis=1) for block in blocks]
    later = np.zeros(n_vertices)
    for block, square in zip(blocks, own, strict=True):
        later[block.rows] += square
    for block, square in zip(blocks, own, strict=True):
        later[block.rows] -= square
        yield np.maximum(later[block.rows], 0.0)
