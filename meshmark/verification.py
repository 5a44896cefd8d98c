"""Verifies an asset: evidence from every mesh by every scheme asked for, then the verdict."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from meshmark.animation import Asset, MeshAnimation
from meshmark.defaults import DEFAULT_GEODESIC, DEFAULT_SCHEME, DEFAULT_SEGMENTER
from meshmark.detection import Extraction
from meshmark.errors import CapacityError
from meshmark.evidence import Evidence
from meshmark.keys import Key, unique_recipients
from meshmark.marking import MeshProgress, as_asset
from meshmark.parallel import sharing_workers
from meshmark.plugins import catalogue
from meshmark.recipe import Recipe
from meshmark.timeline import AUTO, frames_in
from meshmark.validation import check
from meshmark.verdict import Verdict, decide, without_weight


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
    """
    start = time.perf_counter()
    whole = asset if isinstance(asset, Asset) else as_asset(asset)
    tried = tuple(recipes) or all_schemes()
    for animation in whole.meshes:
        check(animation)
    items: list[Evidence] = []
    notes: list[str] = []
    for recipe in tried:
        for view in _views(whole, recipe, jobs):
            chosen = frames_in(view.animation, frames)
            try:
                restorations = view.restorations if restored else (0,)
                items.append(view.look(chosen, restorations, _told(progress, view)))
            except CapacityError as error:
                notes.append(_note(view, error))
            notes.extend(_passed_over(view))
    elapsed = time.perf_counter() - start
    return AssetEvidence(whole.source, tuple(items), len(tried), tuple(notes), elapsed)


def _views(asset: Asset, recipe: Recipe, jobs: int) -> list[Extraction]:
    scheme = recipe.build()
    return [Extraction(mesh, scheme, recipe.scheme, jobs=jobs) for mesh in asset.meshes]


def _told(progress: MeshProgress | None, view: Extraction) -> Callable[[int, int], None] | None:
    return None if progress is None else partial(progress, view.animation.prim)


def _note(view: Extraction, error: CapacityError) -> str:
    return f"{view.animation.prim}: {view.name}: {error.message}"


def _passed_over(view: Extraction) -> list[str]:
    if view.passed_over == 0:
        return []
    return [
        f"{view.animation.prim}: {view.name}: {view.passed_over} of {view.asked} frames are "
        "blends of those beside them, and were passed over"
    ]


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
        Names to try beside the owner's own mark; each is paid for.
    frames : str, optional
        Range A:B[:S] of time codes to look at, all by default; or "auto", for few frames
        first and more only while they do not decide.
    fpr : float
        False-positive rate: the largest p that counts as marked.

    Raises
    ------
    InputError
        If a frame cannot be read.
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
    schemes, tried one after the other. Parameters are those of `verify`.
    """
    start = time.perf_counter()
    whole = asset if isinstance(asset, Asset) else as_asset(asset)
    tried = tuple(recipes) or all_schemes()
    names = unique_recipients(recipients)
    for animation in whole.meshes:
        check(animation)
    best: Verdict | None = None
    notes: list[str] = []
    for recipe in tried:
        views = _views(whole, recipe, jobs)
        for number, look in enumerate(LOOKS):
            items: list[Evidence] = []
            for view in views:
                try:
                    items.append(look.at(view, _told(progress, view)))
                except CapacityError as error:
                    if number == len(LOOKS) - 1:
                        notes.append(_note(view, error))
            verdict = decide(
                whole.source,
                items,
                key,
                recipients=names,
                fpr=fpr,
                n_schemes=len(tried),
                share=look.share,
            )
            if best is None or _better(verdict, best):
                best = verdict
            if verdict.verdict == "marked":
                break
        notes.extend(note for view in views for note in _passed_over(view))
        if best is not None and best.verdict == "marked":
            break
    assert best is not None
    return replace(best, elapsed_s=time.perf_counter() - start, notes=tuple(notes))


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
        Number of frames, evenly spaced from the first, beside those of smaller looks; None
        for all.
    restored : bool
        Whether smoothing is undone, too.
    share : float
        Share of the false-positive rate it may spend.
    """

    frames: int | None
    restored: bool
    share: float

    def at(self, view: Extraction, progress: Callable[[int, int], None] | None) -> Evidence:
        """Measure that much of a mesh; what was measured before is not measured again."""
        chosen = self.chosen(len(view.animation))
        return view.look(chosen, view.restorations if self.restored else (0,), progress)

    def chosen(self, total: int) -> list[int]:
        """Spread the frames evenly over `total`, those of all smaller looks among them."""
        if self.frames is None:
            return list(range(total))
        smaller = [look.frames for look in LOOKS if look.frames and look.frames <= self.frames]
        spread = [np.linspace(0, total - 1, min(n, total)).round() for n in smaller]
        return np.unique(np.concatenate(spread)).astype(int).tolist()


# Half of the rate is kept for the look at everything: what few frames cannot show, all must.
LOOKS = (
    Look(1, False, 1 / 8),
    Look(1, True, 1 / 8),
    Look(4, True, 1 / 8),
    Look(12, True, 1 / 8),
    Look(None, True, 1 / 2),
)


def judge_all(
    evidence: AssetEvidence, key: Key, *, recipients: Sequence[str] = (), fpr: float = 1e-6
) -> Verdict:
    """Try a key, and any recipients, on evidence that was measured before."""
    start = time.perf_counter()
    verdict = decide(
        evidence.source,
        evidence.items,
        key,
        recipients=unique_recipients(recipients),
        fpr=fpr,
        n_schemes=evidence.n_schemes,
        notes=evidence.notes,
    )
    elapsed = evidence.elapsed_s + time.perf_counter() - start
    verdict = replace(verdict, elapsed_s=elapsed)
    return verdict if evidence.authenticated else without_weight(verdict)
