"""Measures all that an asset shows by every scheme asked for, before any key is tried."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from meshmark.detection.candidates import candidates, whole_meshes
from meshmark.detection.evidence import Evidence
from meshmark.detection.extraction import Extraction
from meshmark.detection.looks import EVERYTHING, Look
from meshmark.errors import CapacityError, InputError
from meshmark.extension.recipe import Recipe, blind_layers
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
    original : str or None
        What some of it was measured beside.
    files : sequence of (str, str)
        Path and SHA-256 of every file that was read, if that is known.
    """

    source: str
    items: tuple[Evidence, ...]
    n_schemes: int
    notes: tuple[str, ...]
    elapsed_s: float
    authenticated: bool = True
    original: str | None = None
    files: Sequence[tuple[str, str]] = ()


@sharing_workers
def gather(
    asset: Asset | MeshAnimation,
    *,
    recipes: Sequence[Recipe] = (),
    frames: str | None = None,
    look: Look = EVERYTHING,
    restored: bool = True,
    parts: bool = True,
    jobs: int = 1,
    progress: MeshProgress | None = None,
) -> AssetEvidence:
    """Measure the evidence of every mesh; no key is involved.

    Parameters
    ----------
    recipes : sequence of Recipe
        Schemes to try; where empty, the blind layers that `embed` lays by default.
    frames : str, optional
        Range A:B[:S] of time codes to look at; all by default.
    look : Look
        How many of these frames; all by default.
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
    survey = Survey(
        asset, recipes=recipes, frames=frames, parts=parts, jobs=jobs, progress=progress
    )
    views = survey.extractions(survey.recipes)
    items = survey.evidence(views, look if restored else replace(look, restored="none"))
    survey.conclude(views)
    notes, elapsed = survey.notes(), time.perf_counter() - start
    return AssetEvidence(survey.source, tuple(items), len(survey.recipes), notes, elapsed)


class Survey:
    """Looks at what an asset holds, and keeps what must be said of it.

    Parameters
    ----------
    asset : Asset or MeshAnimation
        The copy.
    recipes, frames, parts, jobs
        As `gather` takes them.
    progress : callable, optional
        Called with (prim, frames done, frames in all).
    """

    def __init__(
        self,
        asset: Asset | MeshAnimation,
        *,
        recipes: Sequence[Recipe],
        frames: str | None,
        parts: bool = True,
        jobs: int,
        progress: MeshProgress | None,
    ) -> None:
        whole = asset if isinstance(asset, Asset) else as_asset(asset)
        within, left_out = in_range(whole, frames)
        wanted = candidates(within) if parts else whole_meshes(within)
        self.source = whole.source
        self.recipes = tuple(recipes) or blind_layers()
        # Groups of frames that agree with each other may lie outside the range.
        self._candidates = [each for each in wanted if has_frame_in(each.animation, frames)]
        self._frames, self._jobs, self._progress = frames, jobs, progress
        self._known = (
            *whole.notes,
            *(f"{each.prim}: {each.reason}" for each in left_out),
            *(f"passed over: {mesh.prim}: {mesh.flaw}" for mesh in within.meshes if mesh.flaw),
        )
        self._notes: dict[str, list[str]] = {}
        self._unreadable: dict[str, InputError] = {}
        self._reasons: dict[int, CapacityError] = {}
        # Of the last look by each extraction: frames wanted, how many were worth observing, and
        # how many there are.
        self._observed: dict[int, tuple[int, int, int]] = {}
        self._has_read = False

    def extractions(self, recipes: Sequence[Recipe]) -> list[Extraction]:
        """Get ready to look at every candidate by some of the schemes."""
        return [
            Extraction(candidate, scheme, name, jobs=self._jobs)
            for scheme, name in [(recipe.build(), recipe.scheme) for recipe in recipes]
            for candidate in self._candidates
        ]

    def evidence(self, views: Sequence[Extraction], look: Look) -> list[Evidence]:
        """Measure what a look shows; what was measured before is not measured again."""
        items: list[Evidence] = []
        for view in views:
            items += self._evidence(view, look)
            if len(views) > 1:
                # Of many large meshes, it would be too much.
                view.release()
        return items

    def seen(self, views: Sequence[Extraction]) -> tuple[int, int]:
        """Count the frames that the last look was at, and all there are, of the longest mesh."""
        counts = [self._observed[id(view)] for view in views if id(view) in self._observed]
        return max(((wanted, total) for wanted, _, total in counts), key=max, default=(0, 0))

    def can_give_up(self, views: Sequence[Extraction]) -> bool:
        """Tell whether there is more to look at, and all frames that were could be read."""
        unreadable = self._unreadable or any(view.unreadable for view in views)
        return not unreadable and self.seen(views)[1] > 1

    def give_up(self, views: Sequence[Extraction]) -> None:
        """Keep that no further look is taken, for lack of hope."""
        wanted, total = self.seen(views)
        self._known = (
            *self._known,
            f"{views[0].name}: {wanted} of {total} frames give no hope of a mark, and no more was "
            "looked at; frames : looks at everything",
        )

    def conclude(self, views: Sequence[Extraction]) -> None:
        """Keep what must be said of candidates by a scheme, when no look follows."""
        for view in views:
            self._conclude(view)

    def notes(self) -> tuple[str, ...]:
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
        return (*self._known, *dict.fromkeys(unread), *said)

    def _evidence(self, view: Extraction, look: Look) -> list[Evidence]:
        try:
            within = frames_in(view.animation, self._frames)
            frames = look.chosen(within, view.settle(within))
            tell = self._teller(view)
            if tell is not None:
                # A frame can take long: what it belongs to is to be known before it is done.
                tell(0, len(frames))
            poses = view.worth_observing(frames)
            self._observed[id(view)] = len(frames), len(poses), len(within)
            measured = view.look(poses, look.restorations(view.restorations), tell)
        except CapacityError as error:
            self._has_read = True
            self._reasons[id(view)] = error
            return []
        except InputError as error:
            self._unreadable.setdefault(view.candidate.name, error)
            return []
        self._has_read = True
        self._reasons.pop(id(view), None)
        return [measured]

    def _conclude(self, view: Extraction) -> None:
        reason = self._reasons.pop(id(view), None)
        # What parts cannot hold is nothing that the mesh they belong to could not.
        if reason is not None and not view.candidate.part:
            self._note(view, reason.message)
        wanted, observed, _ = self._observed.pop(id(view), (0, 0, 0))
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

    def _teller(self, view: Extraction) -> Callable[[int, int], None] | None:
        if self._progress is None:
            return None
        return partial(self._progress, f"{view.candidate.name} by {view.name}")


def _listed(names: Sequence[str]) -> str:
    """Name a few, and count the rest."""
    shown = ", ".join(names[:MOST_NAMED])
    return f"{shown} and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else shown
