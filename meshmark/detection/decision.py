"""How a verdict is reached: a key tried on evidence, with every search corrected for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.detection.evidence import Evidence
from meshmark.detection.joint_verdict import best_of_each, best_of_each_scheme
from meshmark.detection.pooling import POOLED_SHARE, Pool, pools
from meshmark.detection.searched import Searched
from meshmark.detection.significance import HypothesisResult, judge_each
from meshmark.detection.verdict import (
    Answer,
    InformedVerdict,
    Named,
    PooledVerdict,
    PrimVerdict,
    Verdict,
)
from meshmark.keys import Key
from meshmark.workers.pool import one_thread

# Stands for no share at all, where a logarithm is taken.
TINY = 1e-300


def decide(
    source: str,
    evidence: Sequence[Evidence],
    key: Key,
    *,
    recipients: Sequence[str] = (),
    fpr: float = 1e-6,
    n_schemes: int = 1,
    share: float = 1.0,
    largest_share: float | None = None,
    notes: Sequence[str] = (),
) -> Verdict:
    """Answer for a source from the evidence of its meshes; whoever measured sets the seconds.

    Parameters
    ----------
    evidence : sequence of Evidence
        One for each mesh and scheme that could be measured.
    recipients : sequence of str
        Recipients to try beside the owner's own words.
    fpr : float
        Largest p that still counts as marked.
    n_schemes : int
        Number of schemes tried; every mesh is corrected for them.
    share : float
        Share of the false-positive rate that this verdict may spend, where several are asked
        for: the shares of all must sum to at most 1.
    largest_share : float, optional
        The largest of those: what a file could have reached is told by that.

    Notes
    -----
    The best of n hypotheses is worth n times its p (union bound): schemes and recipients for
    each mesh; a verdict that may spend a share of the rate, its p over that share. Meshes and
    parts of meshes share what a scheme may spend by what they could show, see `shares`: a part
    with the share w is worth its p over w. Where a scheme measured several, half of what it may
    spend is for what they say together, see `pooled`.
    """
    hypotheses: tuple[str | None, ...] = (None, *recipients)
    correction = float(np.log10(n_schemes * len(hypotheses) / share))
    log10_fpr = float(np.log10(fpr))
    spare = float(np.log10((largest_share or share) / share))
    corrections, of_pools = corrected_for(evidence, correction)
    # Last digits must not depend on whether evidence was measured just now or read from a file.
    with one_thread():
        judged = [
            _Judged.of(item, key, hypotheses, float(each), log10_fpr)
            for item, each in zip(evidence, corrections, strict=True)
        ]
        several = [_Several.of(pool, key, hypotheses, each, log10_fpr) for pool, each in of_pools]
    if not judged:
        return Verdict.of_nothing(source, notes)
    by_prim: dict[str, list[_Judged]] = {}
    for one in judged:
        for prim in (one.evidence.prim, *one.evidence.also):
            by_prim.setdefault(prim, []).append(one)
    prims = tuple(_prim_verdict(prim, ones, log10_fpr, spare) for prim, ones in by_prim.items())
    all_judged: list[_Judged | _Several] = [*judged, *several]
    best = min(all_judged, key=lambda one: one.log10_p)
    reachable = min(one.reachable for one in all_judged) - spare
    answer = _answer(best.log10_p, reachable, log10_fpr)
    searched = Searched(
        beside=any(item.informed is not None for item in evidence),
        schemes=n_schemes,
        names=len(hypotheses),
        candidates=len(all_judged),
        candidate_share=float(10.0 ** (correction - best.correction)),
        look_share=share,
        log10_p=best.log10_p,
    )
    return Verdict(
        source=source,
        verdict=answer,
        log10_p=best.log10_p,
        recipient=best.recipient if answer == "marked" else None,
        elapsed_s=0.0,
        prims=prims,
        notes=tuple(notes),
        recipients=best_of_each(named for one in all_judged for named in one.named),
        pooled=best_of_each_scheme(one.verdict for one in several),
        hope=min(one.unlimited_log10_p for one in all_judged) + float(np.log10(share)),
        searched=(searched,),
    )


def corrected_for(
    evidence: Sequence[Evidence], correction: float
) -> tuple[FloatArray, list[tuple[Pool, float]]]:
    """Tell what each mesh and part, (n,), and each pool is corrected by, in log10.

    Parameters
    ----------
    correction : float
        What all are corrected by: log10 of the number of schemes times that of names, over the
        share of the rate.
    """
    return correction - shares(evidence), [
        (pool, correction - share) for pool, share in pooled(evidence)
    ]


def pooled(evidence: Sequence[Evidence]) -> list[tuple[Pool, float]]:
    """List what is judged together, each with log10 of its share of its scheme's rate."""
    found = []
    for scheme in dict.fromkeys(item.scheme for item in evidence):
        of_scheme = pools([item for item in evidence if item.scheme == scheme])
        found += [(pool, float(np.log10(POOLED_SHARE / len(of_scheme)))) for pool in of_scheme]
    return found


def shares(evidence: Sequence[Evidence]) -> FloatArray:
    """Share a scheme's rate among the meshes and parts it was tried on, (n,), in log10.

    By the square of what each could reach at best, in decades: no key is needed to tell that,
    and hundreds of cubes that hold no chips beside a body then cost it nothing. Where several are
    judged together, too, that has a share of its own, see `pooled`.
    """
    reach = np.array([item.reachable_log10_p for item in evidence]) ** 2
    schemes = np.array([item.scheme for item in evidence])
    total = np.array([reach[schemes == scheme].sum() for scheme in schemes])
    count = np.array([np.sum(schemes == scheme) for scheme in schemes])
    share = np.where(total > 0.0, reach / np.maximum(total, TINY), 1.0 / np.maximum(count, 1))
    together = {pool.scheme for pool, _ in pooled(evidence)}
    share *= [1.0 - POOLED_SHARE if scheme in together else 1.0 for scheme in schemes]
    return np.log10(np.maximum(share, TINY))


@dataclass(frozen=True, eq=False)
class _Judged:
    """What a key makes of one mesh, or part of one, by one scheme, corrected for every search.

    Parameters
    ----------
    evidence : Evidence
        What was measured.
    findings : sequence of HypothesisResult
        One for each name that was tried, the best first.
    correction : float
        Log10 of the number of hypotheses this one is the best of, by the union bound.
    log10_fpr : float
        Largest log10 p that counts as marked.
    """

    evidence: Evidence
    findings: Sequence[HypothesisResult]
    correction: float
    log10_fpr: float

    @classmethod
    def of(
        cls,
        evidence: Evidence,
        key: Key,
        hypotheses: Sequence[str | None],
        correction: float,
        log10_fpr: float,
    ) -> _Judged:
        """Try a key and every recipient; where nothing is held, nothing fits."""
        if not evidence.held.any():
            return cls(
                evidence, [HypothesisResult.of_nothing(len(evidence.times))], correction, log10_fpr
            )
        findings = judge_each(evidence, key, hypotheses, log10_fpr - correction)
        return cls(evidence, findings, correction, log10_fpr)

    def corrected(self, log10_p: float) -> float:
        """Correct for multiple testing over schemes, recipients, meshes, parts and looks."""
        return min(0.0, log10_p + self.correction)

    @property
    def unlimited_log10_p(self) -> float:
        """Corrected bound for what fits best, before it is limited to 0."""
        return self.findings[0].unlimited_log10_p + self.correction

    @property
    def log10_p(self) -> float:
        """Bound for what fits best."""
        return self.corrected(self.findings[0].log10_p)

    @property
    def recipient(self) -> str | None:
        """Whose words fit best."""
        return self.findings[0].recipient

    @property
    def reachable(self) -> float:
        """Lowest bound that the best of keys could reach."""
        return self.evidence.reachable_log10_p + self.correction

    @property
    def named(self) -> Iterator[Named]:
        """Everybody whose words are in it."""
        for finding in self.findings:
            log10_p = self.corrected(finding.log10_p)
            if log10_p <= self.log10_fpr:
                alone = finding.log10_p_per_frame + self.correction <= self.log10_fpr
                times = self.evidence.times[alone]
                yield Named(finding.recipient, log10_p, tuple(times.tolist()))


@dataclass(frozen=True, eq=False)
class _Several:
    """What a key makes of several meshes together, corrected for every search.

    Parameters
    ----------
    verdict : PooledVerdict
    unlimited_log10_p : float
        Corrected bound for what fits best, before it is limited to 0.
    recipient : str or None
        Whose words fit best.
    reachable : float
        Lowest bound that the best of keys could reach.
    named : tuple of Named
        Everybody whose words are in it.
    correction : float
        Log10 of the number of hypotheses that the bound is the best of.
    """

    verdict: PooledVerdict
    unlimited_log10_p: float
    recipient: str | None
    reachable: float
    named: tuple[Named, ...]
    correction: float

    @classmethod
    def of(
        cls,
        pool: Pool,
        key: Key,
        hypotheses: Sequence[str | None],
        correction: float,
        log10_fpr: float,
    ) -> _Several:
        """Try a key and every recipient."""
        words = key.words_of(pool.scheme, pool.n_words, pool.n_chips, hypotheses)
        unlimited = pool.unlimited_log10_p(words) + correction
        log10_p = np.minimum(0.0, unlimited)
        best = int(np.argmin(unlimited))
        fitting = np.flatnonzero(log10_p <= log10_fpr).tolist()
        return cls(
            PooledVerdict(pool.scheme, len(pool.evidence), float(log10_p[best])),
            float(unlimited[best]),
            hypotheses[best],
            pool.reachable_log10_p + correction,
            tuple(Named(hypotheses[n], float(log10_p[n])) for n in fitting),
            correction,
        )

    @property
    def log10_p(self) -> float:
        """Bound for what fits best."""
        return self.verdict.log10_p


def _prim_verdict(
    prim: str, judged: Sequence[_Judged], log10_fpr: float, spare: float
) -> PrimVerdict:
    best = min(judged, key=lambda one: one.log10_p)
    evidence, finding = best.evidence, best.findings[0]
    facts = evidence.informed
    others = tuple(name for name in (evidence.prim, *evidence.also) if name != prim)
    return PrimVerdict(
        prim=prim,
        scheme=evidence.scheme,
        verdict=_answer(best.log10_p, min(one.reachable for one in judged) - spare, log10_fpr),
        log10_p=best.log10_p,
        recipient=finding.recipient,
        chips=evidence.chips,
        times=tuple(float(t) for t in evidence.times),
        finding=finding,
        part=evidence.part,
        also=others,
        recipients=best_of_each(named for one in judged for named in one.named),
        informed=None if facts is None else InformedVerdict(best.log10_p, facts),
    )


def _answer(log10_p: float, reachable: float, log10_fpr: float) -> Answer:
    if log10_p <= log10_fpr:
        return "marked"
    return "inconclusive" if reachable > log10_fpr else "not marked"
