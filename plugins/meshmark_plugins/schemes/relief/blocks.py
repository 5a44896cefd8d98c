"""What the chips of each block raise and lower, near it: no other block's chips are needed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from meshmark.arrays import FloatArray, IntArray
from meshmark_plugins.schemes.relief.basis import BLOCK, Basis, Level, mixed

# Rings of patches about a block that its chips are felt in, and one more that they are solved in.
RINGS = 2


@dataclass(frozen=True, eq=False)
class Block:
    """Chips that are mixed with each other, and the heights they give.

    Parameters
    ----------
    chips : slice
        Which of all chips.
    rows : (R,) int
        Which of the vertices that were asked for they are felt at.
    heights : (R, k) float32
        Of each of the k chips there.
    """

    chips: slice
    rows: IntArray
    heights: FloatArray


def blocks(basis: Basis, vertices: IntArray) -> Iterator[Block]:
    """List the blocks of the finest level, with their heights at some vertices (n,).

    A height dies out within two patches. It is solved for where it is felt only: a system of a few
    hundred vertices a block, not one of all vertices for each of thousands of chips.
    """
    level, share = basis.levels[-1], basis.shares[-1]
    first = basis.n_chips - level.n_chips
    near = _near(level)
    place = np.full(len(level.label), -1)
    place[vertices] = np.arange(len(vertices))
    for start in range(0, level.n_chips, BLOCK):
        end = min(start + BLOCK, level.n_chips)
        ring = np.zeros(level.n_chips, dtype=bool)
        ring[start:end] = True
        for _ in range(RINGS):
            ring = near @ ring
        felt, inside = ring, near @ ring
        at = np.flatnonzero(inside[level.label])
        patches = level.patches(start, end, at)
        rows = np.flatnonzero(felt[level.label[at]] & (place[at] >= 0))
        G = np.sqrt(share) * patches[rows] @ mixed(np.eye(end - start))
        yield Block(slice(first + start, first + end), place[at[rows]], G.astype(np.float32))


def _near(level: Level) -> csr_matrix:
    """Tell which patches touch each other, (K, K) bool; each touches itself."""
    A = level.smoother.matrix.tocoo()
    shape = (level.n_chips, level.n_chips)
    pairs = (np.ones(A.nnz, dtype=bool), (level.label[A.row], level.label[A.col]))
    return csr_matrix(pairs, shape=shape, dtype=bool)
