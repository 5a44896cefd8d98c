"""The scheme itself: anchors and chips of a frame for detection, a plan for marking."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.extension.carrier import Observation
from meshmark.extension.interfaces import GeodesicSolver, Segmenter
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.statistics.word_windows import WordPosterior
from meshmark_plugins.schemes.apex.anchors.components import reference_root_area
from meshmark_plugins.schemes.apex.anchors.detect import detect_anchors, distance_to_border
from meshmark_plugins.schemes.apex.anchors.geodesic_field import GeodesicField
from meshmark_plugins.schemes.apex.anchors.track import MIN_PERSISTENCE_DETECTED, FrameAnchors
from meshmark_plugins.schemes.apex.chips.hypotheses import (
    CUT_WORTH,
    OFFSETS,
    Guesses,
    cells_needed,
    measure,
    soften,
    worth,
)
from meshmark_plugins.schemes.apex.chips.radial_histogram import profiles_of, vertex_weights
from meshmark_plugins.schemes.apex.chips.word_index import N_WORDS, bulk, place_of
from meshmark_plugins.schemes.apex.marking.plan import SurfacePlan, plan_animation, require_capacity
from meshmark_plugins.schemes.apex.parameters import Tuning

# Anchors beyond the words' number that detection still looks at: some will be false.
SPARE = 2
# Evidence that a bit must exceed: what a chip has at most that a cut runs through, and seven to
# three in odds, as it is tanh of half their logarithm.
BIT_THRESHOLD = CUT_WORTH
# Belief that an anchor is a false one: where it stands out as little as those that are not
# marked, where it does as those that are, and on a border, which a cut may have made. How near to
# a border that is, in root areas.
FLAT, HIGH = (0.08, 0.12), (0.6, 0.15)
FALSE_ON_BORDER, ON_BORDER = 0.7, 0.05


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
        bins: int = 16,
        width: float = 0.04,
        words: int = 8,
        strength: float = 0.36,
        max_mrms: float = 2.2e-4,
        hold: int = 4,
    ) -> None:
        self.tuning = Tuning(bins, width, words, strength, max_mrms, hold)

    @property
    def n_chips(self) -> int:
        """Chips of one anchor."""
        return self.tuning.bins

    @property
    def n_words(self) -> int:
        """Code words, listed by the bulk of the anchors they are for."""
        return N_WORDS

    def observe(self, frame: Frame, reference: Frame | None = None) -> Observation:
        """Find the anchors of a frame, and read the chips about them."""
        K, width = self.tuning.bins, self.tuning.width
        most = self.tuning.words + SPARE
        found = detect_anchors(frame.points, frame.faces, MIN_PERSISTENCE_DETECTED, most)
        fields = [anchors.geodesic_field() for anchors in found]
        own = fields[0].reference_root_area
        whole = own if reference is None else _length_of(reference)
        guesses = Guesses.about(whole)
        soft, places, p_nulls = [], [], []
        for field in fields:
            profiles = profiles_of(
                field, vertex_weights(field, width), width, cells_needed(K, width)
            )
            scales = guesses.scales(field.length_scale * (whole / own))
            believed = worth(profiles, K, width, scales, OFFSETS)
            soft.append(believed * soften(*measure(profiles, K, scales, OFFSETS)))
            place = place_of(bulk(profiles, width, scales))
            places.append(np.repeat(place, len(OFFSETS), axis=0))
            p_nulls.append(p_null_of(field))
        return Observation(
            soft=np.concatenate(soft, axis=1),
            log_prior=guesses.log_prior,
            descriptors=np.column_stack(
                [
                    np.concatenate([field.disc_area_share for field in fields]),
                    np.concatenate([field.mean_geodesic_distance for field in fields]),
                ]
            ),
            vertices=np.concatenate([field.anchors for field in fields]),
            posterior=WordPosterior(np.concatenate(places, axis=1), np.concatenate(p_nulls)),
            bit_threshold=BIT_THRESHOLD,
        )

    def require_capacity(self, animation: MeshAnimation, *, jobs: int = 1) -> None:
        """Refuse an animation without lasting anchors, or with too few vertices about them."""
        require_capacity(FrameAnchors(animation, jobs), self.tuning)

    def plan(self, animation: MeshAnimation, words: IntArray, *, jobs: int = 1) -> SurfacePlan:
        """Find lasting anchors, and the displacement that marks about them in every pose."""
        return plan_animation(animation, words, self.tuning, jobs)


@lru_cache(maxsize=8)
def _length_of(frame: Frame) -> float:
    """Length in which the largest piece of a frame is measured; asked for again and again."""
    return reference_root_area(frame.points, frame.faces)


def p_null_of(field: GeodesicField) -> FloatArray:
    """Believe so much that the anchors of a piece hold no word, (C,)."""
    own = np.searchsorted(field.component.vertices, field.anchors)
    gap = distance_to_border(field.V, field.component.faces, own)
    p_null = np.interp(field.persistence, FLAT, HIGH)
    return np.where(
        gap <= ON_BORDER * field.length_scale, np.maximum(p_null, FALSE_ON_BORDER), p_null
    )
