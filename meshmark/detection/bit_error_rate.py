"""Bit error rates by the published protocol; no verdict rests on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from meshmark.arrays import FloatArray, IntArray
from meshmark.detection.evidence import STEPS, Evidence
from meshmark.statistics.p_values import approximate_log_mean_by_hypothesis
from meshmark.statistics.word_windows import WINDOW_SIZE, WordPosterior

# A part whose every other bit is an erasure shows a small bit error rate by luck alone.
DECIDED_SHARE = 0.5
# Stands for "out of the question" in sums that must stay finite.
_NEVER = -1e6


@dataclass(frozen=True, eq=False)
class BitErrors:
    """Bit error rates by the published protocol: the smallest among the parts of each frame.

    Parameters
    ----------
    per_frame : (T,) float64
        NaN for a frame in which no part decides enough bits.
    best_part : (T,) int
        The part that has it, the first of equals; -1 where no part decides enough bits.
    """

    per_frame: FloatArray
    best_part: IntArray

    @property
    def average(self) -> float:
        """Mean over the frames, NaN if none decides."""
        known = self.per_frame[~np.isnan(self.per_frame)]
        return float(known.mean()) if known.size else float("nan")

    @property
    def maximum(self) -> float:
        """Largest over the frames, NaN if none decides."""
        known = self.per_frame[~np.isnan(self.per_frame)]
        return float(known.max()) if known.size else float("nan")


def bit_errors(evidence: Evidence, words: IntArray) -> BitErrors:
    """Compare the bits of every part with its word, frame by frame.

    Erasures, and chips that say no more than is `bit_threshold` for their scheme, are neither right
    nor wrong: they leave the numerator and the denominator. A part that decides less than half
    of its bits in a frame is left out of that frame.

    Where vertices keep their identity and there is one hypothesis, which part holds which word is
    told by all frames together. Otherwise each frame is taken by itself, as the published protocol
    does: a part of one frame need not be there in another, and of several hypotheses the one that
    speaks most for the words is taken, which need not be the same in every pose. Where vertices
    keep their identity, what it says in all frames together counts beside what it says in one:
    the copy was treated alike in all of them.
    """
    if len(words) == 1 or (evidence.tracked and _read_in_one_way(evidence)):
        return _errors_of(evidence, words, _scores(evidence, words))
    shared = _scores(evidence, words) if evidence.tracked else None
    # One frame at a time: each works out large tables of its own.
    frames = (evidence.select([t]) for t in range(len(evidence.times)))
    alone = [_errors_of(frame, words, _scores(frame, words, shared)) for frame in frames]
    return BitErrors(
        per_frame=np.concatenate([errors.per_frame for errors in alone]),
        best_part=np.concatenate([errors.best_part for errors in alone]),
    )


def _read_in_one_way(evidence: Evidence) -> bool:
    return len(evidence.variants) == 1 and len(evidence.variants[0].log_prior) == 1


def _errors_of(evidence: Evidence, words: IntArray, scores: list[FloatArray]) -> BitErrors:
    """Compare the bits of frames whose parts hold the same words, under the best hypothesis."""
    best = int(np.argmax([score.max() for score in scores]))
    variant, hypothesis = evidence.variants[best], int(np.argmax(scores[best]))
    posterior = variant.posterior and variant.posterior.under(hypothesis)
    fit = _fits(variant.pooled[[hypothesis]], words, posterior)[0]
    steps = variant.under(hypothesis)
    # Rounded like the evidence itself: what is just as much does not exceed it.
    decided = np.abs(steps.astype(np.int64)) > np.rint(evidence.bit_threshold * STEPS)
    return _bit_errors(fit, np.where(decided, steps, 0), words)


def _scores(
    evidence: Evidence, words: IntArray, beside: list[FloatArray] | None = None
) -> list[FloatArray]:
    """How much each hypothesis of each variant speaks for the words, and did so before, (R,) each.

    Where places tell words, that is the logarithm of the e-value: the more false carriers there
    are, the better some word fits each of them by luck.
    """
    scores = []
    for variant in evidence.variants:
        if variant.posterior is not None:
            score = approximate_log_mean_by_hypothesis(
                variant.pooled, variant.belief, words, variant.posterior
            )
        else:
            score = _fits(variant.pooled, words, None).max(axis=-1).sum(axis=-1)
        scores.append(score)
    return scores if beside is None else [a + b for a, b in zip(scores, beside, strict=True)]


def _fits(S: FloatArray, words: IntArray, posterior: WordPosterior | None) -> FloatArray:
    """How well words fit evidence S (R, C, K), (R, C, M); `_NEVER` where they may not be."""
    fit: FloatArray = S @ words.T.astype(np.float64)
    if posterior is not None:
        windows = posterior.windows(len(words))
        within = np.arange(len(words)) - windows.first[..., None]
        fit = np.where((within >= 0) & (within < WINDOW_SIZE), fit, _NEVER)
    return fit


def _bit_errors(fit: FloatArray, bits: NDArray[np.int8], words: IntArray) -> BitErrors:
    """Compare bits (T, C, K) with the words that fit (C, M) the parts best."""
    C, K = bits.shape[1:]
    if len(words) == 1:
        carriers, of = np.arange(C), np.zeros(C, dtype=np.int64)
    else:
        carriers, of = linear_sum_assignment(fit, maximize=True)
        # Carriers that crowd about a place may be more than the words there.
        possible = fit[carriers, of] > _NEVER
        carriers, of = carriers[possible], of[possible]
    bits = bits[:, carriers]
    wrong = (bits != 0) & (np.sign(bits) != words[of])
    decided = (bits != 0).sum(axis=2)
    counts = decided >= DECIDED_SHARE * K
    rate = np.where(counts, wrong.sum(axis=2) / np.maximum(decided, 1), np.inf)
    best = rate.min(axis=1, initial=np.inf)
    found = np.isfinite(best)
    return BitErrors(
        per_frame=np.where(found, best, np.nan),
        best_part=np.where(found, carriers[rate.argmin(axis=1)], -1),
    )
