"""The scheme itself: one carrier of all vertices, binned by norm; moves towards the centre."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import CapacityError, UsageError
from meshmark.extension.carrier import Carrier, measure
from meshmark.extension.parameters import require_number, require_whole
from meshmark.mesh.animation import Frame
from meshmark_plugins.schemes.cho2007.norms import NormBins, bin_norms
from meshmark_plugins.schemes.cho2007.power import exponents

WHAT = "scheme cho2007"
# Fewer vertices than this many a bin, on average, and the bins' means are mostly chance.
MIN_VERTICES_PER_BIN = 4
# Norms that differ by less, as a share of the largest, differ by float32 rounding.
MIN_NORM_SPREAD = 1e-6


class Cho2007:
    """Bits in the mean of each bin of vertex norms.

    Parameters
    ----------
    bits : int
        N_w, bins (and bits) of the mesh; 2 to 1024.
    strength : float
        Alpha: how far from 1/2 a bin's mean is pushed, in widths of the bin; in (0, 0.5).

    Notes
    -----
    Frames have nothing in common but the key: each is marked on its own norms, from its own
    centre of gravity, as the paper marks a single mesh. Moves of one frame mean nothing in
    another pose, so that `propagate` is "adapt" and cannot be chosen. Moving vertices shifts
    the centre a little, and with it all norms; the core's loop measures again and corrects.
    """

    def __init__(
        self,
        *,
        bits: int = 64,
        strength: float = 0.05,
    ) -> None:
        require_whole(WHAT, "bits", bits, 2, 1024)
        require_number(WHAT, "strength", strength, 0.0, 0.5)
        self.n_chips = bits
        self.n_words = 1
        self.strength = strength
        self.propagate = "adapt"
        self.rehearsal = 0

    def layout(self, frame: Frame) -> None:
        """Check that a frame can hold a mark; trajectories carry nothing.

        Raises
        ------
        CapacityError
            If it has too few vertices, or all equally far from their centre.
        """
        fewest = MIN_VERTICES_PER_BIN * self.n_chips
        if len(frame.points) < fewest:
            raise CapacityError(
                f"{len(frame.points)} points cannot hold {self.n_chips} bits; "
                f"it takes at least {fewest}"
            )
        norm = bin_norms(frame.points, self.n_chips).norm
        if np.ptp(norm) <= MIN_NORM_SPREAD * norm.max():
            raise CapacityError("all points are equally far from their centre of gravity")

    def carriers(self, frame: Frame, layout: None) -> list[NormBins]:
        """Bin the vertices by their distance from the centre of gravity."""
        return [bin_norms(frame.points, self.n_chips)]

    def move(
        self,
        frame: Frame,
        layout: None,
        carriers: Sequence[Carrier],
        shifts: Sequence[FloatArray],
        rng: np.random.Generator,
    ) -> FloatArray:
        """Apply to each bin the power map that shifts its mean by what is wanted."""
        (carrier,), (shift,) = carriers, shifts
        assert isinstance(carrier, NormBins)
        moving = np.flatnonzero((carrier.bins >= 0) & (shift[carrier.bins] != 0.0))
        bins, u = carrier.bins[moving], carrier.bin_fraction[moving]
        target = 0.5 + measure(carriers).value[0] + shift
        k = exponents(u, bins, target)[bins]
        # The extremes of a bin, and with them the bins, stay exactly where they are.
        between = (u > 0.0) & (u < 1.0)
        moving, bins, u, k = moving[between], bins[between], u[between], k[between]
        norm = carrier.lower[bins] + carrier.width[bins] * u**k
        ray = frame.points[moving] - carrier.centre
        points = frame.points.copy()
        points[moving] = carrier.centre + ray * (norm / carrier.norm[moving])[:, None]
        return points

    def carry(
        self, frame: Frame, layout: None, reference: Frame, marked: Frame, words: IntArray
    ) -> FloatArray:
        """Refuse: the norms of one pose say nothing about those of another."""
        raise UsageError(f"{WHAT} marks every frame by itself and carries no moves")
