"""Looks at few frames of a copy first, and at more only while they do not decide."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from meshmark.detection.candidates import candidates
from meshmark.detection.evidence import Evidence
from meshmark.detection.extraction import Extraction
from meshmark.detection.gathering import Survey, extractions
from meshmark.detection.verdict import Verdict, decide, together
from meshmark.errors import InputError
from meshmark.extension.recipe import Recipe, all_schemes
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset, as_asset
from meshmark.recipients import spellings
from meshmark.workers.ordered_map import sharing_workers
from meshmark.workers.progress import MeshProgress


@sharing_workers
def verify_in_looks(
    asset: Asset | MeshAnimation,
    key: Key,
    *,
    recipes: Sequence[Recipe] = (),
    recipients: Sequence[str] = (),
    fpr: float = 1e-6,
    jobs: int = 1,
    progress: MeshProgress | None = None,
) -> Verdict:
    """Look at few frames first, and at more only while the answer is not "marked".

    The looks are fixed beforehand, and share the false-positive rate among them; so do the
    schemes, tried one after the other. Where several recipients are asked for, a marked copy is
    looked at whole, so that all who are in it are named. Parameters are those of `verify`.
    """
    start = time.perf_counter()
    whole = asset if isinstance(asset, Asset) else as_asset(asset)
    tried = tuple(recipes) or all_schemes()
    names = spellings(recipients)
    wanted = candidates(whole)
    survey = Survey(progress)

    def judged(views: Sequence[Extraction], look: Look) -> Verdict:
        return decide(
            whole.source,
            [item for view in views for item in look.at(view, survey)],
            key,
            recipients=names,
            fpr=fpr,
            n_schemes=len(tried),
            share=look.share,
        )

    best: Verdict | None = None
    for recipe in tried:
        views = extractions(wanted, recipe, jobs)
        for look in LOOKS:
            verdict = judged(views, look)
            if best is None or _better(verdict, best):
                best = verdict
            if verdict.verdict == "marked":
                break
        assert best is not None
        if best.verdict == "marked" and len(names) > 1 and look is not LOOKS[-1]:
            best = together(best, judged(views, NAMING))
        for view in views:
            survey.conclude(view)
        if best.verdict == "marked":
            break
    assert best is not None
    notes = (*whole.notes, *survey.told())
    return replace(best, elapsed_s=time.perf_counter() - start, notes=notes)


def _better(new: Verdict, old: Verdict) -> bool:
    """Prefer the lower p; "not marked", which needs more evidence, to "inconclusive"."""
    if new.log10_p != old.log10_p:
        return new.log10_p < old.log10_p
    # Of equals the later one, which has seen more.
    return new.verdict == old.verdict or old.verdict == "inconclusive"


@dataclass(frozen=True)
class Look:
    """How much of an animation is looked at before a verdict is asked for.

    Parameters
    ----------
    frames : int or None
        Number of frames, evenly spaced, beside those of smaller looks; None for all.
    restored : bool
        Whether smoothing is undone, too.
    share : float
        Share of the false-positive rate it may spend.
    """

    frames: int | None
    restored: bool
    share: float

    def at(self, view: Extraction, survey: Survey) -> list[Evidence]:
        """Measure that much of a mesh; what was measured before is not measured again."""
        try:
            chosen = self.chosen(len(view.animation), view.settle())
        except InputError:
            # The look itself says so.
            chosen = list(range(len(view.animation)))
        return survey.evidence(view, chosen, view.restorations if self.restored else (0,))

    def chosen(self, total: int, first: int = 0) -> list[int]:
        """Spread the frames evenly over `total`, `first` and those of all smaller looks included.

        A look at one frame is at `first`.
        """
        if self.frames is None:
            return list(range(total))
        smaller = [n for look in LOOKS if (n := look.frames or 0) and 1 < n <= self.frames]
        spread = [np.linspace(0, total - 1, min(n, total)).round() for n in smaller]
        return np.unique(np.concatenate([[first], *spread])).astype(int).tolist()


# Half of the rate is kept for the look at everything: what few frames cannot show, all must.
LOOKS = (
    Look(1, False, 1 / 8),
    Look(1, True, 1 / 8),
    Look(4, True, 1 / 8),
    Look(12, True, 1 / 8),
    Look(None, True, 1 / 2),
)
# Whoever asks for several names wants all that are in any mesh or frame: what the look at
# everything did not spend is spent on that.
NAMING = Look(None, False, 1 / 2)
