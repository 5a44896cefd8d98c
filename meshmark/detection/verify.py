"""Verifies an asset: looks that grow while they do not decide, each with its verdict."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from meshmark.detection.decision import decide
from meshmark.detection.extraction import Extraction
from meshmark.detection.gathering import AssetEvidence, Survey
from meshmark.detection.joint_verdict import TRIPLE, jointly, together
from meshmark.detection.looks import (
    EVERYTHING,
    GIVEN_UP,
    HOPE,
    LOOKS,
    NAMING,
    QUICK,
    Look,
    TakenLook,
)
from meshmark.detection.verdict import End, Verdict, without_weight
from meshmark.errors import CapacityError, UsageError
from meshmark.extension.recipe import Recipe, default_layers
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset, as_asset
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
    original: Asset | MeshAnimation | None = None,
    master: Asset | Callable[[], Asset] | None = None,
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
        Schemes to try, with the parameters they were embedded with; by default those that
        `embed` marks by, the ones that need the original only where it is given.
    recipients : sequence of str
        Names to try beside the owner's own mark, in every form of `spellings`; each is
        corrected for.
    frames : str, optional
        Range A:B[:S] of time codes to look at, all by default; or "auto", for few frames
        first, and more only while they do not decide and leave hope.
    fpr : float
        False-positive rate: the largest p that counts as marked.
    original : Asset or MeshAnimation, optional
        What the copy may have been made from. Informed schemes read the copy beside it.
    master : Asset or callable, optional
        The original as the blind layers left it; or what makes it, called only if the original
        alone does not decide.

    Raises
    ------
    InputError
        If no frame of any mesh can be read.
    UsageError
        If only informed schemes are asked for and there is no original, or the other way round.

    Notes
    -----
    With "auto" the looks are fixed beforehand, and share the false-positive rate; so do the
    schemes, tried one after the other. Whoever takes fewer looks only finds fewer marks: giving up
    after the quick ones costs no rate. Where several recipients are asked for, a marked copy is
    looked at whole, so that all who are in it are named.

    With an original, the copy is read beside it first, and by itself only if that does not decide.
    """
    start = time.perf_counter()
    tried = tuple(recipes) or default_layers()
    blind = [recipe for recipe in tried if not recipe.informed]
    informed = [recipe for recipe in tried if recipe.informed]
    copy = _as_asset(asset)
    names = spellings(recipients)
    if original is None:
        if not blind:
            raise UsageError(f"scheme {tried[0].scheme} reads a copy beside its original only")
        verdict = verify_blindly(
            copy, key, blind, names, frames=frames, fpr=fpr, jobs=jobs, progress=progress
        )
        return replace(verdict, elapsed_s=time.perf_counter() - start)
    if not informed:
        raise UsageError(f"scheme {tried[0].scheme} makes no use of an original")
    verdict = verify_informed(
        copy,
        key,
        informed,
        names,
        original=_as_asset(original),
        master=master,
        frames=frames,
        fpr=fpr,
        jobs=jobs,
        progress=progress,
    )
    if blind:
        # What decides by itself is corrected like the best of three: it might not have decided.
        alone = Verdict.of_nothing(copy.source)
        if verdict.log10_p + TRIPLE > np.log10(fpr):
            alone = verify_blindly(
                copy, key, blind, names, frames=frames, fpr=fpr, jobs=jobs, progress=progress
            )
        verdict = jointly(alone, verdict, fpr)
    return replace(verdict, elapsed_s=time.perf_counter() - start)


def verify_blindly(
    asset: Asset,
    key: Key,
    recipes: Sequence[Recipe],
    names: Sequence[str],
    *,
    frames: str | None,
    fpr: float,
    jobs: int,
    progress: MeshProgress | None,
) -> Verdict:
    """Look at a copy alone; parameters are those of `verify`."""
    survey = Survey(asset, recipes=recipes, frames=frames, jobs=jobs, progress=progress)
    looks, one_by_one = (LOOKS, True) if frames == AUTO else ((EVERYTHING,), False)

    def judged(views: Sequence[Extraction], look: Look) -> Verdict:
        return decide(
            survey.source,
            survey.evidence(views, look),
            key,
            recipients=names,
            fpr=fpr,
            n_schemes=len(survey.recipes),
            share=look.share,
            largest_share=looks[-1].share,
        )

    best: Verdict | None = None
    taken: list[TakenLook] = []
    ended: End = "all seen"
    for tried in [(recipe,) for recipe in survey.recipes] if one_by_one else [survey.recipes]:
        views = survey.extractions(tried)
        hope = math.inf
        for look in looks:
            verdict = judged(views, look)
            schemes = tuple(recipe.scheme for recipe in tried)
            taken.append(TakenLook(schemes, survey.seen(views)[0], look.restored, verdict.log10_p))
            hope = min(hope, verdict.hope)
            if best is None or _better(verdict, best):
                best = verdict
            if verdict.verdict == "marked":
                ended = "marked"
                break
            without_hope = hope > HOPE and all(name in GIVEN_UP for name in schemes)
            if look is QUICK[-1] and without_hope and survey.can_give_up(views):
                ended = "no hope"
                survey.give_up(views)
                break
        assert best is not None
        if ended == "marked" and look is not looks[-1] and len(names) > 1:
            best = together(best, judged(views, NAMING))
        survey.conclude(views)
        if ended == "marked":
            break
    assert best is not None
    return replace(best, notes=survey.notes(), looks=tuple(taken), ended=ended)


def verify_informed(
    copy: Asset,
    key: Key,
    recipes: Sequence[Recipe],
    names: Sequence[str],
    *,
    original: Asset,
    master: Asset | Callable[[], Asset] | None,
    frames: str | None,
    fpr: float,
    jobs: int,
    progress: MeshProgress | None,
) -> Verdict:
    """Look at a copy beside its original; parameters are those of `verify`.

    Where the master has to be made, the looks before and after it share the rate.
    """
    judged = partial(
        judge_beside,
        copy,
        key,
        recipes,
        names,
        original=original,
        frames=frames,
        fpr=fpr,
        jobs=jobs,
        progress=progress,
    )
    if not callable(master):
        return judged(master=master)
    first = judged(master=None, share=1 / 2)
    if not first.prims or first.log10_p + TRIPLE <= np.log10(fpr):
        return first
    try:
        made = master()
    except CapacityError:
        # No mesh can hold a blind layer: nothing lies between original and copy.
        return first
    return together(first, judged(master=made, share=1 / 2))


def judge_beside(
    copy: Asset,
    key: Key,
    recipes: Sequence[Recipe],
    names: Sequence[str],
    *,
    original: Asset,
    master: Asset | None,
    frames: str | None,
    fpr: float,
    share: float = 1.0,
    points_in_place: float | None = None,
    jobs: int,
    progress: MeshProgress | None,
) -> Verdict:
    """Read a copy beside its original once, and try a key.

    Parameters are those of `verify`, `decide` and `gather_informed`.
    """
    # Whoever looks at a copy alone has no use for what places it on an original.
    from meshmark.detection.informed import gather_informed

    found = gather_informed(
        copy,
        original,
        recipes,
        master=master,
        frames=frames,
        points_in_place=points_in_place,
        jobs=jobs,
        progress=progress,
    )
    verdict = decide(
        copy.source,
        found.items,
        key,
        recipients=names,
        fpr=fpr,
        n_schemes=len(recipes),
        share=share,
        notes=found.notes,
    )
    return replace(verdict, original=original.source)


def _as_asset(asset: Asset | MeshAnimation) -> Asset:
    return asset if isinstance(asset, Asset) else as_asset(asset)


def judge_all(
    evidence: AssetEvidence, key: Key, *, recipients: Sequence[str] = (), fpr: float = 1e-6
) -> Verdict:
    """Try a key, and any recipients, on evidence that was measured before."""
    start = time.perf_counter()
    judged = partial(
        decide,
        evidence.source,
        key=key,
        recipients=spellings(recipients),
        fpr=fpr,
        notes=evidence.notes,
    )
    alone = [item for item in evidence.items if item.informed is None]
    verdict = judged(alone, n_schemes=max(1, evidence.n_schemes))
    if evidence.original is not None:
        beside = [item for item in evidence.items if item.informed is not None]
        n_informed = max(1, len({item.scheme for item in beside}))
        informed = replace(judged(beside, n_schemes=n_informed), original=evidence.original)
        verdict = jointly(verdict, informed, fpr) if evidence.n_schemes else informed
    elapsed = evidence.elapsed_s + time.perf_counter() - start
    verdict = replace(verdict, elapsed_s=elapsed)
    return verdict if evidence.authenticated else without_weight(verdict)


def _better(new: Verdict, old: Verdict) -> bool:
    """Prefer the lower p; "not marked", which needs more evidence, to "inconclusive"."""
    if new.log10_p != old.log10_p:
        return new.log10_p < old.log10_p
    # Of equals the later one, which has seen more.
    return new.verdict == old.verdict or old.verdict == "inconclusive"
