"""The space of reliefs on one surface: from signed chips to heights, and the transpose."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.fft import dct, idct
from scipy.sparse import csc_matrix, csr_matrix, diags_array

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import vertex_areas
from meshmark.mesh.laplacian import cotangent_weights, stiffness_matrix
from meshmark_plugins.schemes.relief.inverse import Inverse, coarse_space, factored
from meshmark_plugins.schemes.relief.patches import patch_labels

# Patches of the coarse and the fine level at most, and vertices that one fine patch needs.
COARSE, FINE = 400, 3000
VERTICES_PER_PATCH = 3
# Share of the energy in the coarse level.
COARSE_SHARE = 0.4
# Chips that are mixed with each other: heights of patches are then spread like a normal
# distribution, and the lowest of several copies still resembles each of them.
BLOCK = 32
# Radius of what is no relief any more, in coarse patches.
WIDE = 2.0
# Words by which the mean height is found out.
PROBES = 16
# Columns that are solved for at once: they then fit into a processor's cache.
AT_ONCE = 16


class Level:
    """Patches of one size, smoothed by half of that.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions of the reference.
    F : (F, 3) int
        Triangles.
    n_patches : int
        K.
    space : (N, n) sparse, optional
        See `Smoother`.

    Attributes
    ----------
    n_chips : int
        Chips, one a patch.
    label : (N,) int
        Patch of each vertex.
    """

    def __init__(
        self, V: FloatArray, F: IntArray, n_patches: int, space: csr_matrix | None = None
    ) -> None:
        self.label = patch_labels(V, F, n_patches)
        self.n_chips = int(self.label.max()) + 1
        radius = 0.5 * np.sqrt(vertex_areas(V, F).sum() / self.n_chips)
        self.smoother = Smoother(V, F, radius, space)
        probes = np.random.default_rng(0).choice((-1.0, 1.0), (self.n_chips, PROBES))
        mean_square = self.smoother.mass @ self._smoothed(probes) ** 2 / self.smoother.mass.sum()
        self._gain = 1.0 / np.sqrt(mean_square.mean())

    def heights(self, w: FloatArray) -> FloatArray:
        """Heights (N,) of chips w (K,), or (N, n) of (K, n); of random signs, 1 in mean square."""
        return self._gain * self._smoothed(w)

    def adjoint(self, x: FloatArray) -> FloatArray:
        """Apply the transpose of `heights` to x (N,) or (N, n)."""
        return self._gain * unmixed(self.by_patch(self.smoother.adjoint(x)))

    def patches(self, start: int, end: int, at: IntArray) -> FloatArray:
        """Heights (n, end - start) of some patches, each by itself, as if `at` (n,) were all."""
        own = self.label[at, None] == np.arange(start, end)
        return self._gain * self.smoother.within(at, own.astype(np.float64))

    def by_patch(self, x: FloatArray) -> FloatArray:
        """Sum values (N,) or (N, n) over patches."""
        if x.ndim == 1:
            return np.bincount(self.label, x, self.n_chips).astype(np.float64, copy=False)
        return np.stack([np.bincount(self.label, c, self.n_chips) for c in x.T], axis=1)

    def _smoothed(self, w: FloatArray) -> FloatArray:
        return self.smoother(mixed(w)[self.label])


class Smoother:
    """Applies (M + t L)^-1 M: a mean over about a disc, for any values on the vertices.

    Parameters
    ----------
    V : (N, 3) float64
    F : (F, 3) int
    radius : float
        sqrt(t).
    space : (N, n) sparse, optional
        Columns of fields among which what is smoothed is approximated; by default all are.
    """

    def __init__(
        self, V: FloatArray, F: IntArray, radius: float, space: csr_matrix | None = None
    ) -> None:
        area = vertex_areas(V, F)
        self.mass = np.maximum(area, 1e-9 * area.mean())
        L = stiffness_matrix(F, cotangent_weights(V, F), len(V))
        self.matrix = csc_matrix(diags_array(self.mass) + radius**2 * L)
        self.space = space

    @cached_property
    def _inverse(self) -> Inverse:
        return Inverse(self.matrix, self.space)

    def __call__(self, x: FloatArray) -> FloatArray:
        """Smooth x (N,) or (N, n)."""
        if x.ndim == 1:
            return self._inverse(self.mass * x)
        smooth = np.empty(x.shape)
        for some in (slice(n, n + AT_ONCE) for n in range(0, x.shape[1], AT_ONCE)):
            smooth[:, some] = self._inverse(self.mass[:, None] * x[:, some])
        return smooth

    def adjoint(self, x: FloatArray) -> FloatArray:
        """Apply the transpose."""
        return (self.mass * self._inverse(x).T).T

    def within(self, at: IntArray, x: FloatArray) -> FloatArray:
        """Smooth x (m, n) on some vertices (m,), as if all others were held at 0."""
        return factored(self.matrix[at][:, at]).solve((self.mass[at] * x.T).T)


@dataclass(frozen=True, eq=False)
class Basis:
    """Heights as a linear map of chips, on two levels that share the energy.

    Parameters
    ----------
    levels : tuple of Level
    shares : (len(levels),) float64
        Energy of each; they sum to 1.
    wide : Smoother
        Over discs larger than any patch.
    """

    levels: tuple[Level, ...]
    shares: FloatArray
    wide: Smoother

    @classmethod
    def of(cls, V: FloatArray, F: IntArray) -> Basis:
        """Make the basis of a reference surface; see `patch_labels`."""
        fine = min(FINE, len(V) // VERTICES_PER_PATCH)
        coarse = min(COARSE, fine // 4)
        sizes = (coarse, fine) if coarse >= 8 else (fine,)
        shares = np.array([COARSE_SHARE, 1.0 - COARSE_SHARE]) if len(sizes) == 2 else np.ones(1)
        space = coarse_space(V, F)
        wide = Smoother(V, F, WIDE * np.sqrt(vertex_areas(V, F).sum() / sizes[0]), space)
        return cls(tuple(Level(V, F, n, space) for n in sizes), shares, wide)

    @property
    def n_chips(self) -> int:
        """K, of all levels."""
        return sum(level.n_chips for level in self.levels)

    def heights(self, w: FloatArray) -> FloatArray:
        """Heights (N,) of chips (K,), or (N, n) of (K, n); of random signs, 1 in mean square."""
        return sum(
            np.sqrt(share) * level.heights(part)
            for share, level, part in zip(self.shares, self.levels, self._split(w), strict=True)
        )

    def adjoint(self, x: FloatArray) -> FloatArray:
        """Apply the transpose of `heights` to x (N,) or (N, n)."""
        return np.concatenate(
            [
                np.sqrt(share) * level.adjoint(x)
                for share, level in zip(self.shares, self.levels, strict=True)
            ]
        )

    def low_pass(self, x: FloatArray, count: FloatArray) -> FloatArray:
        """Smooth values (N, n), each the mean of so many, over discs larger than any patch."""
        total = self.wide(np.hstack([count * x, count]) / self.wide.mass[:, None])
        sums, counts = np.hsplit(total, 2)
        return sums / np.maximum(counts, 1e-300)

    def squares(self, x: FloatArray) -> FloatArray:
        """Approximate the diagonal of `adjoint` diag(x) `heights`, (K,), for x (N,) >= 0."""
        return np.concatenate(
            [
                share * _block_means(level.by_patch(x))
                for share, level in zip(self.shares, self.levels, strict=True)
            ]
        )

    def _split(self, w: FloatArray) -> list[FloatArray]:
        ends = np.cumsum([level.n_chips for level in self.levels])[:-1]
        return np.split(w, ends)


def mixed(w: FloatArray) -> FloatArray:
    """Mix chips (K,) or (K, n) with others of their block, by a rotation."""
    return np.concatenate([_rows(dct(block, axis=1, norm="ortho")) for block in _blocks(w)])


def unmixed(h: FloatArray) -> FloatArray:
    """Undo `mixed`, and apply its transpose."""
    return np.concatenate([_rows(idct(block, axis=1, norm="ortho")) for block in _blocks(h)])


def _blocks(x: FloatArray) -> list[FloatArray]:
    """Cut x (K, ...) into blocks (n, BLOCK, ...), and one of what is left, (1, rest, ...)."""
    whole = len(x) // BLOCK * BLOCK
    blocks = [x[:whole].reshape(-1, BLOCK, *x.shape[1:]), x[None, whole:]]
    return [block for block in blocks if block.size]


def _rows(blocks: FloatArray) -> FloatArray:
    return blocks.reshape(-1, *blocks.shape[2:])


def _block_means(x: FloatArray) -> FloatArray:
    means = (
        np.broadcast_to(block.mean(axis=1, keepdims=True), block.shape) for block in _blocks(x)
    )
    return np.concatenate([_rows(block) for block in means])
