"""Verifies an asset: evidence from every mesh by every scheme asked for, then the verdict."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from meshmark.animation import Asset, MeshAnimation
from meshmark.candidates import Candidate, candidates
from meshmark.defaults import DEFAULT_GEODESIC, DEFAULT_SCHEME, DEFAULT_SEGMENTER
from meshmark.detection import Extraction
from meshmark.errors import CapacityError, InputError
from meshmark.evidence import Evidence
from meshmark.keys import Key
from meshmark.marking import MeshProgress, as_asset
from meshmark.parallel import sharing_workers
from meshmark.plugins import catalogue
from meshmark.recipe import Recipe
from meshmark.recipients import spellings
from meshmark.timeline import AUTO, frames_in, in_range
from meshmark.verdict import Verdict, decide, together, without_weight

# Meshes that one remark is made of, by name.
MOST_NAMED = 3


@dataclass(frozen=True, eq=False)
class AssetEvidence:
    """What an asset says before any key is tried.

    Parameters
    ----------
    source : str
        The asset.
    items : tuple of Evidence
        One for each mesh and scheme that could be measured.
    n_schemes : int
        Schemes tried.
    notes : tuple of str
        What was not measured, and why.
    elapsed_s : float
        Seconds spent measuring.
    authenticated : bool
        Whether it is known where it was measured; no verdict rests on other evidence.
    """

    source: str
    items: tuple[Evidence, ...]
    n_schemes: int
    notes: tuple[str, ...]
    elapsed_s: float
    authenticated: bool = True


def all_schemes() -> tuple[Recipe, ...]:
    """Return a recipe for each scheme there is, with its default parameters."""
    return tuple(Recipe(name, DEFAULT_SEGMENTER, DEFAULT_GEODESIC) for name in scheme_names())


def scheme_names() -> tuple[str, ...]:
    """Return the names of all schemes there are, the default first."""
    names = [offer.name for offer in catalogue().of_kind("scheme")]
    return tuple(sorted(names, key=lambda name: (name != DEFAULT_SCHEME, name)))


@sharing_workers
def gather(
    asset: Asset | MeshAnimation,
    *,
    recipes: Sequence[Recipe] = (),
    frames: str | None = None,
    restored: bool = True,
    parts: bool = True,
    jobs: int = 1,
    progress: MeshProgress | None = None,
) -> AssetEvidence:
    """Measure the evidence of every mesh; no key is involved.

    Parameters
    ----------
    recipes : sequence of Recipe
        Schemes to try; all there are, with default parameters, where empty.
    frames : str, optional
        Range A:B[:S] of time codes to look at; all by default.
    restored : bool
        Whether to look, too, at what the copy was before it may have been smoothed.
    parts : bool
        Whether to look, too, at parts of meshes, and at meshes put together, by themselves.

    Raises
    ------
    InputError
        If no frame of any mesh can be read.
    """
    start = time.perf_counter()
    whole = asset if isinstance(asset, Asset) else as_asset(asset)
    tried = tuple(recipes) or all_schemes()
    whole, beyond = in_range(whole, frames)
    wanted = candidates(whole) if parts else [Candidate(mesh) for mesh in whole.meshes]
    survey = _Survey(progress)
    items: list[Evidence] = []
    for recipe in tried:
        for view in _views(wanted, recipe, jobs):
            chosen = frames_in(view.animation, frames)
            restorations = view.restorations if restored else (0,)
            items += survey.evidence(view, chosen, restorations)
            survey.conclude(view)
    elapsed = time.perf_counter() - start
    unseen = (f"{each.prim}: {each.reason}" for each in beyond)
    notes = (*whole.notes, *unseen, *survey.told())
    return AssetEvidence(whole.source, tuple(items), len(tried), notes, elapsed)


def _views(wanted: Sequence[Candidate], recipe: Recipe, jobs: int) -> list[Extraction]:
    scheme = recipe.build()
    return [Extraction(candidate, scheme, recipe.scheme, jobs=jobs) for candidate in wanted]


class _Survey:
    """Looks at one candidate after the other, and keeps what must be said of them.

    Parameters
    ----------
    progress : callable, optional
        Called with (prim, frames done, frames in all).
    """

    def __init__(self, progress: MeshProgress | None) -> None:
        self._progress = progress
        self._notes: dict[str, list[str]] = {}
        self._unreadable: dict[str, InputError] = {}
        self._reasons: dict[int, CapacityError] = {}
        self._has_read = False

    def evidence(
        self, view: Extraction, frames: Sequence[int], restorations: tuple[int, ...]
    ) -> list[Evidence]:
        """Measure some frames; nothing where there is nothing to measure."""
        try:
            found = view.look(frames, restorations, self._told(view))
        except CapacityError as error:
            self._has_read = True
            self._reasons[id(view)] = error
            return []
        except InputError as error:
            self._unreadable.setdefault(view.candidate.name, error)
            return []
        self._has_read = True
        self._reasons.pop(id(view), None)
        return [found]

    def conclude(self, view: Extraction) -> None:
        """Keep what must be said of a candidate by a scheme, when no more is asked of it."""
        reason = self._reasons.get(id(view))
        # What parts cannot hold is nothing that the mesh they belong to could not.
        if reason is not None and not view.candidate.part:
            self._note(view, reason.message)
        if view.passed_over:
            self._note(
                view,
                f"{view.passed_over} of {view.asked} frames are blends of those beside them, "
                "and were passed over",
            )
        if not view.candidate.part:
            for error in view.unreadable.values():
                self._unreadable.setdefault(f"{view.candidate.name} {error.time}", error)

    def _note(self, view: Extraction, text: str) -> None:
        self._notes.setdefault(f"{view.name}: {text}", []).append(view.candidate.name)

    def told(self) -> tuple[str, ...]:
        """Return all that must be said.

        Raises
        ------
        InputError
            If nothing at all could be read; the first reason.
        """
        errors = list(self._unreadable.values())
        if errors and not self._has_read:
            raise errors[0]
        unread = (f"passed over: {error.without_source()}" for error in errors)
        said = (f"{_listed(names)}: {text}" for text, names in self._notes.items())
        return (*dict.fromkeys(unread), *said)

    def _told(self, view: Extraction) -> Callable[[int, int], None] | None:
        return None if self._progress is None else partial(self._progress, view.candidate.name)


def _listed(names: Sequence[str]) -> str:
    """Name a few, and count the rest."""
    shown = ", ".join(names[:MOST_NAMED])
    return f"{shown} and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else shown


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
        Names to try beside the owner's own mark, in every form of `spellings`; each is paid for.
    frames : str, optional
        Range A:B[:S] of time codes to look at, all by default; or "auto", for few frames
        first and more only while they do not decide.
    fpr : float
        False-positive rate: the largest p that counts as marked.

    Raises
    ------
    InputError
        If no frame of any mesh can be read.
    """
    if frames == AUTO:
        return verify_in_looks(
            asset,
            key,
            recipes=recipes,
            recipients=recipients,
            fpr=fpr,
            jobs=jobs,
            progress=progress,
        )
    evidence = gather(asset, recipes=recipes, frames=frames, jobs=jobs, progress=progress)
    return judge_all(evidence, key, recipients=recipients, fpr=fpr)


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
    survey = _Survey(progress)

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
        views = _views(wanted, recipe, jobs)
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

    def at(self, view: Extraction, survey: _Survey) -> list[Evidence]:
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
