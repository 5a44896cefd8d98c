"""Verifies an asset: looks that grow while they do not decide, each with its verdict."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

from meshmark.detection.decision import decide
from meshmark.detection.extraction import Extraction
from meshmark.detection.gathering import AssetEvidence, Survey
from meshmark.detection.looks import EVERYTHING, LOOKS, NAMING, Look
from meshmark.detection.verdict import Verdict, together, without_weight
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.frame_range import AUTO
from meshmark.recipients import spellings
from meshmark.workers.ordered_map import sharing_workers
from meshmark.workers.progress import MeshProgress


@sharing_workers
def verify(
    asset: Asset | MeshAnimation,
    key: Key,
    *,
    recipes: Sequence[Recipe] = (),
    recipients: Sequence[str] = (),
    frames: str | None = None,
    fpr: float = 1e-6,
    jobs: int = 1,
    progress: MeshProgress | None = None,
) -> Verdict:
    """Say whether an asset bears the key's mark, and whose copy it is.

    Parameters
    ----------
    asset : Asset or MeshAnimation
        The suspicious copy, from `meshmark.read`.
    key : Key
        The owner's key.
    recipes : sequence of Recipe
        Schemes to try, with the parameters they were embedded with; by default every scheme
        there is, with its defaults.
    recipients : sequence of str
        Names to try beside the owner's own mark, in every form of `spellings`; each is
        corrected for.
    frames : str, optional
        Range A:B[:S] of time codes to look at, all by default; or "auto", for few frames
        first and more only while they do not decide.
    fpr : float
        False-positive rate: the largest p that counts as marked.

    Raises
    ------
    InputError
        If no frame of any mesh can be read.

    Notes
    -----
    With "auto" the looks are fixed beforehand, and share the false-positive rate; so do the
    schemes, tried one after the other. Where several recipients are asked for, a marked copy is
    looked at whole, so that all who are in it are named.
    """
    start = time.perf_counter()
    survey = Survey(asset, recipes=recipes, frames=frames, jobs=jobs, progress=progress)
    names = spellings(recipients)
    looks, one_by_one = (LOOKS, True) if frames == AUTO else ((EVERYTHING,), False)

    def judged(views: Sequence[Extraction], look: Look) -> Verdict:
        return decide(
            survey.source,
            survey.evidence(views, look, last=look is looks[-1]),
            key,
            recipients=names,
            fpr=fpr,
            n_schemes=len(survey.recipes),
            share=look.share,
        )

    best: Verdict | None = None
    for tried in [(recipe,) for recipe in survey.recipes] if one_by_one else [survey.recipes]:
        views = survey.extractions(tried)
        for look in looks:
            verdict = judged(views, look)
            if best is None or _better(verdict, best):
                best = verdict
            if verdict.verdict == "marked":
                break
        assert best is not None
        if look is not looks[-1]:
            if len(names) > 1:
                best = together(best, judged(views, NAMING))
            survey.conclude(views)
        if best.verdict == "marked":
            break
    assert best is not None
    return replace(best, elapsed_s=time.perf_counter() - start, notes=survey.notes())


def judge_all(
    evidence: AssetEvidence, key: Key, *, recipients: Sequence[str] = (), fpr: float = 1e-6
) -> Verdict:
    """Try a key, and any recipients, on evidence that was measured before."""
    start = time.perf_counter()
    verdict = decide(
        evidence.source,
        evidence.items,
        key,
        recipients=spellings(recipients),
        fpr=fpr,
        n_schemes=evidence.n_schemes,
        notes=evidence.notes,
    )
    elapsed = evidence.elapsed_s + time.perf_counter() - start
    verdict = replace(verdict, elapsed_s=elapsed)
    return verdict if evidence.authenticated else without_weight(verdict)


def _better(new: Verdict, old: Verdict) -> bool:
    """Prefer the lower p; "not marked", which needs more evidence, to "inconclusive"."""
    if new.log10_p != old.log10_p:
        return new.log10_p < old.log10_p
    # Of equals the later one, which has seen more.
    return new.verdict == old.verdict or old.verdict == "inconclusive"
