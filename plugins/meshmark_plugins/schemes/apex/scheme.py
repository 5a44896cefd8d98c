"""The scheme itself: anchors and chips of a frame for detection, a plan for marking."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.extension.carrier import Observation
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.statistics.word_windows import WordPosterior
from meshmark_plugins.schemes.apex.anchors.components import reference_root_area
from meshmark_plugins.schemes.apex.anchors.detect import detect_anchors, distance_to_border
from meshmark_plugins.schemes.apex.anchors.geodesic_field import GeodesicField
from meshmark_plugins.schemes.apex.anchors.persistence import MIN_PERSISTENCE_DETECTED
from meshmark_plugins.schemes.apex.anchors.proxies import Proxies, proxies_of
from meshmark_plugins.schemes.apex.chips.radial_histogram import radial_histograms
from meshmark_plugins.schemes.apex.chips.scale_hypotheses import (
    OFFSETS,
    ScaleHypotheses,
    cells_needed,
)
from meshmark_plugins.schemes.apex.chips.soft_chips import (
    CUT_RELIABILITY,
    border_reliability,
    measure_chips,
    soften,
)
from meshmark_plugins.schemes.apex.chips.whitening import whitening_weights
from meshmark_plugins.schemes.apex.chips.word_index import (
    N_WORDS,
    geodesic_disc_areas,
    word_position,
)
from meshmark_plugins.schemes.apex.parameters import Parameters

if TYPE_CHECKING:
    # Who only looks at copies does without all that marks them.
    from meshmark_plugins.schemes.apex.marking.plan import SurfacePlan

# Anchors beyond the number of words that detection still looks at: some will be false.
SPARE_ANCHORS = 2
# Evidence that a bit must exceed: what a chip has at most that a cut runs through, and seven to
# three in odds, as it is tanh of half their logarithm.
BIT_THRESHOLD = CUT_RELIABILITY
# Prior probability that an anchor is false, by its persistence: where it stands out as little as
# those that are not marked, and where it does as those that are.
PERSISTENCE_KNOTS, P_NULL_KNOTS = (0.08, 0.12), (0.6, 0.15)
# And where it is this near to a border, in root areas, which a cut may have made.
P_NULL_ON_BORDER, BORDER_DISTANCE = 0.7, 0.05


class Apex:
    """Bits in the density of vertices about the tips of a shape.

    Parameters
    ----------
    bins, width, words, strength, max_mrms, hold
        See `Parameters`.
    """

    restorations = (0, 10, 30, 50)
    follows_vertices = False

    def __init__(
        self,
        *,
        bins: int = 16,
        width: float = 0.04,
        words: int = 8,
        strength: float = 0.36,
        max_mrms: float = 2.2e-4,
        hold: int = 4,
    ) -> None:
        self.parameters = Parameters(bins, width, words, strength, max_mrms, hold)

    @property
    def n_chips(self) -> int:
        """Chips of one anchor."""
        return self.parameters.bins

    @property
    def n_words(self) -> int:
        """Code words, listed by the disc area of the anchors they are for."""
        return N_WORDS

    def observe(self, frame: Frame, reference: Frame | None = None) -> Observation:
        """Detect the anchors of a frame, and measure the chips about them."""
        K, width = self.parameters.bins, self.parameters.width
        most = self.parameters.words + SPARE_ANCHORS
        proxies = Proxies(frame.points) if reference is None else proxies_of(reference)
        found = detect_anchors(frame.points, frame.faces, MIN_PERSISTENCE_DETECTED, most, proxies)
        fields = [anchors.geodesic_field() for anchors in found]
        own_length = fields[0].reference_root_area
        length = own_length if reference is None else _reference_root_area(reference)
        hypotheses = ScaleHypotheses.about(length)
        soft, positions, p_nulls = [], [], []
        for field in fields:
            weights = whitening_weights(field, width)
            histograms = radial_histograms(field, weights, width, cells_needed(K, width))
            scales = hypotheses.scales(field.length_scale * (length / own_length))
            reliability = border_reliability(histograms, K, width, scales, OFFSETS)
            soft.append(reliability * soften(*measure_chips(histograms, K, scales, OFFSETS)))
            position = word_position(geodesic_disc_areas(histograms, width, scales))
            positions.append(np.repeat(position, len(OFFSETS), axis=0))
            p_nulls.append(p_null_of(field))
        return Observation(
            soft=np.concatenate(soft, axis=1),
            log_prior=hypotheses.log_prior,
            descriptors=np.column_stack(
                [
                    np.concatenate([field.disc_area_share for field in fields]),
                    np.concatenate([field.mean_geodesic_distance for field in fields]),
                ]
            ),
            vertices=np.concatenate([field.anchors for field in fields]),
            posterior=WordPosterior(np.concatenate(positions, axis=1), np.concatenate(p_nulls)),
            bit_threshold=BIT_THRESHOLD,
        )

    def require_capacity(self, animation: MeshAnimation, *, jobs: int = 1) -> None:
        """Refuse an animation without lasting anchors, or with too few vertices about them."""
        from meshmark_plugins.schemes.apex.anchors.track import FrameAnchors
        from meshmark_plugins.schemes.apex.marking.plan import require_capacity

        require_capacity(FrameAnchors(animation, jobs), self.parameters)

    def plan(
        self, animation: MeshAnimation, words: IntArray, *, jobs: int = 1, **_: Any
    ) -> SurfacePlan:
        """Find lasting anchors, and the displacement that marks about them in every pose."""
        from meshmark_plugins.schemes.apex.marking.plan import plan_animation

        return plan_animation(animation, words, self.parameters, jobs)


@lru_cache(maxsize=8)
def _reference_root_area(frame: Frame) -> float:
    """Root area of the largest component of a frame; cached, as many frames share one."""
    return reference_root_area(frame.points, frame.faces)


def p_null_of(field: GeodesicField) -> FloatArray:
    """Prior probability that each anchor of a component is false and holds no word, (C,)."""
    own = np.searchsorted(field.component.vertices, field.anchors)
    gap = distance_to_border(field.V, field.component.faces, own)
    p_null = np.interp(field.persistence, PERSISTENCE_KNOTS, P_NULL_KNOTS)
    on_border = gap <= BORDER_DISTANCE * field.length_scale
    return np.where(on_border, np.maximum(p_null, P_NULL_ON_BORDER), p_null)
