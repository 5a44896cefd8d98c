"""Measures all that an asset shows by every scheme asked for, before any key is tried."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from meshmark.detection.candidates import Candidate, candidates
from meshmark.detection.evidence import Evidence
from meshmark.detection.extraction import Extraction
from meshmark.errors import CapacityError, InputError
from meshmark.extension.recipe import Recipe, all_schemes
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset, as_asset
from meshmark.mesh.frame_range import frames_in, has_frame_in, in_range
from meshmark.workers.ordered_map import sharing_workers
from meshmark.workers.progress import MeshProgress

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
    # Groups of frames that agree with each other may lie beyond the range.
    wanted = [candidate for candidate in wanted if has_frame_in(candidate.animation, frames)]
    survey = Survey(progress)
    items: list[Evidence] = []
    for recipe in tried:
        for view in extractions(wanted, recipe, jobs):
            chosen = frames_in(view.animation, frames)
            restorations = view.restorations if restored else (0,)
            items += survey.evidence(view, chosen, restorations)
            survey.conclude(view)
    elapsed = time.perf_counter() - start
    unseen = (f"{each.prim}: {each.reason}" for each in beyond)
    notes = (*whole.notes, *unseen, *survey.told())
    return AssetEvidence(whole.source, tuple(items), len(tried), notes, elapsed)


def extractions(wanted: Sequence[Candidate], recipe: Recipe, jobs: int) -> list[Extraction]:
    """Get ready to look at candidates by one scheme."""
    scheme = recipe.build()
    return [Extraction(candidate, scheme, recipe.scheme, jobs=jobs) for candidate in wanted]


class Survey:
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
        # Of the last look by each extraction: frames wanted, and how many were worth observing.
        self._observed: dict[int, tuple[int, int]] = {}
        self._has_read = False

    def evidence(
        self, view: Extraction, frames: Sequence[int], restorations: tuple[int, ...]
    ) -> list[Evidence]:
        """Measure some frames; nothing where there is nothing to measure."""
        try:
            tell = self._told(view)
            if tell is not None:
                # A frame can take long: what it belongs to is to be known before it is done.
                tell(0, len(frames))
            view.settle(frames)
            poses = view.worth_observing(frames)
            self._observed[id(view)] = len(frames), len(poses)
            found = view.look(poses, restorations, tell)
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
        wanted, observed = self._observed.get(id(view), (0, 0))
        if observed < wanted:
            self._note(
                view,
                f"{wanted - observed} of {wanted} frames are blends of those beside them, "
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
        if self._progress is None:
            return None
        return partial(self._progress, f"{view.candidate.name} by {view.name}")


def _listed(names: Sequence[str]) -> str:
    """Name a few, and count the rest."""
    shown = ", ".join(names[:MOST_NAMED])
    return f"{shown} and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else shown
