"""The scheme itself: anchors and chips of a frame for detection, a plan for marking."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from meshmark.animation import Frame, MeshAnimation
from meshmark.carrier import Sighting
from meshmark.interfaces import GeodesicSolver, Segmenter
from meshmark_plugins.schemes.apex.consensus import LEAST_SEEN
from meshmark_plugins.schemes.apex.plan import SurfacePlan, plan_animation, require_capacity
from meshmark_plugins.schemes.apex.profile import joined, profiles_of, vertex_weights
from meshmark_plugins.schemes.apex.readings import cells_needed, hypotheses, measure, soften
from meshmark_plugins.schemes.apex.survey import survey
from meshmark_plugins.schemes.apex.tuning import Tuning

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Anchors beyond the words' number that detection still looks at: some will be false.
SPARE = 2


class Apex:
    """Bits in the density of vertices about the tips of a shape.

    Parameters
    ----------
    segmenter, solver
        Given to every scheme; not used by this one.
    bins, width, words, strength, max_mrms, hold
        See `Tuning`.
    """

    restorations = (0, 10, 30, 50)

    def __init__(
        self,
        *,
        segmenter: Segmenter | None = None,
        solver: Callable[[FloatArray, IntArray], GeodesicSolver] | None = None,
        bins: int = 14,
        width: float = 0.045,
        words: int = 8,
        strength: float = 0.3,
        max_mrms: float = 2.2e-4,
        hold: int = 8,
    ) -> None:
        self.tuning = Tuning(bins, width, words, strength, max_mrms, hold)

    @property
    def n_chips(self) -> int:
        """Chips of one anchor."""
        return self.tuning.bins

    @property
    def n_words(self) -> int:
        """Code words, each for an anchor of its own."""
        return self.tuning.words

    def sight(self, frame: Frame) -> Sighting:
        """Find the anchors of a frame, and read the chips about them."""
        K, width = self.tuning.bins, self.tuning.width
        nears = survey(frame.points, frame.faces, LEAST_SEEN, self.tuning.words + SPARE)
        profiles = joined(
            [
                profiles_of(near, vertex_weights(near, width), width, cells_needed(K))
                for near in nears
            ]
        )
        bulk = np.concatenate([near.bulk for near in nears])
        remoteness = np.concatenate([near.remoteness for near in nears])
        # Words were given out in this order.
        order = np.argsort(bulk, kind="stable")
        s, n = measure(profiles, K)
        return Sighting(
            soft=soften(s, n)[:, order],
            log_prior=hypotheses().log_prior,
            descriptors=np.column_stack([bulk, remoteness])[order],
            vertices=np.concatenate([near.anchors for near in nears])[order],
        )

    def require_capacity(self, animation: MeshAnimation, *, jobs: int = 1) -> None:
        """Refuse an animation without lasting anchors, or with too few vertices about them."""
        require_capacity(animation, self.tuning, jobs)

    def plan(self, animation: MeshAnimation, words: IntArray, *, jobs: int = 1) -> SurfacePlan:
        """Find lasting anchors, and the displacement that marks about them in every pose."""
        return plan_animation(animation, words, self.tuning, jobs)
