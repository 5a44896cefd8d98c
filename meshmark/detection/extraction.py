"""Blind extraction: from a leaked animation to evidence, with no key and no original."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence

import numpy as np

from meshmark.detection.candidates import Candidate
from meshmark.detection.carrier_matching import Matcher, aligned, by_looks, by_place, in_order
from meshmark.detection.evidence import Evidence, LazySequence, RestoredVariant
from meshmark.detection.interpolated_frames import own_poses
from meshmark.detection.observer import Observations, Observer, Reference
from meshmark.errors import CapacityError, InputError
from meshmark.extension.carrier import Observation
from meshmark.extension.interfaces import Scheme
from meshmark.mesh.animation import MeshAnimation
from meshmark.workers.disk_list import DiskList
from meshmark.workers.ordered_map import ordered_map
from meshmark.workers.progress import FrameProgress

# Belief that nothing was smoothed; the rest is shared by the restorations a scheme asks for.
UNTOUCHED = 0.6


class Extraction:
    """Evidence of one mesh, gathered frame by frame: looking at more frames costs only those.

    Parameters
    ----------
    candidate : Candidate or MeshAnimation
        The copy, or a part of it.
    scheme : Scheme
        What is measured.
    scheme_name : str
        Its name, by which keys derive words.
    jobs : int
        Processes that work, this one among them.
    """

    def __init__(
        self,
        candidate: Candidate | MeshAnimation,
        scheme: Scheme,
        scheme_name: str,
        *,
        jobs: int = 1,
    ) -> None:
        if isinstance(candidate, MeshAnimation):
            candidate = Candidate(candidate)
        self.candidate, self.animation = candidate, candidate.animation
        self.scheme, self.name, self.jobs = scheme, scheme_name, jobs
        # The frame that others are compared with; the first look chooses one among its own.
        self.reference = candidate.reference
        # That frame, read and welded, for the next look.
        self._kept: Reference | None = None
        # Frames that cannot be read, and why.
        self.unreadable: dict[int, InputError] = {}
        # Numbers of observations by frame and restoration; of long animations there is much.
        self._seen: dict[tuple[int, int], int] = {}
        # Seconds an observation takes, once that is known.
        self._pace: float | None = None
        self._spool: DiskList[Observation | None] = DiskList()
        self._bit_threshold = 0.0

    @property
    def restorations(self) -> tuple[int, ...]:
        """Every hypothesis of smoothing the scheme wants undone, 0 first."""
        return self.scheme.restorations

    def settle(self, frames: Sequence[int] | None = None) -> int:
        """Choose the frame that others are compared with, among some or all; only once.

        Raises
        ------
        InputError
            If none can be read.
        """
        if self.reference is None:
            among = range(len(self.animation)) if frames is None else frames
            self.reference = self.candidate.lengths.reference(among)
        return self.reference

    def worth_observing(self, frames: Sequence[int]) -> list[int]:
        """Leave out frames that are mere blends of their neighbours, where the scheme minds."""
        if self.scheme.follows_vertices:
            return list(frames)
        return own_poses(self.animation, frames)

    def look(
        self,
        frames: Sequence[int],
        restorations: tuple[int, ...] | None = None,
        progress: FrameProgress | None = None,
    ) -> Evidence:
        """Measure the frames that were not yet, and return the evidence of them all.

        Frames that cannot be read are left out, and kept in `unreadable`.

        Raises
        ------
        CapacityError
            If the scheme finds no carrier in any of the frames.
        InputError
            If none of the frames can be read.
        """
        wanted = self.restorations if restorations is None else restorations
        reference = self._reference_at(self.settle(frames))
        frames = self._readable(frames)
        missing = [t for t in frames if any((t, n) not in self._seen for n in wanted)]
        new = tuple(n for n in wanted if any((t, n) not in self._seen for t in missing))
        done = len(frames) - len(missing)
        try:
            if missing:
                observer = Observer(reference, self.scheme, new)
                for t, observations in zip(missing, self._measured(observer, missing), strict=True):
                    if isinstance(observations, InputError):
                        self.unreadable[t] = observations
                    else:
                        for n, observation in zip(new, observations, strict=True):
                            self._keep(t, n, observation)
                    done += 1
                    if progress is not None:
                        progress(done, len(frames))
            frames = self._readable(frames)
            variants = tuple(self._variant(frames, n, reference) for n in wanted)
        except CapacityError as error:
            raise CapacityError(
                error.message, source=self.animation.origin, prim=self.animation.prim
            ) from None
        kept = tuple(variant for variant in variants if variant is not None)
        if not kept or kept[0].restored != 0:
            raise CapacityError(
                "no carrier is found in any frame",
                source=self.animation.origin,
                prim=self.animation.prim,
            )
        return Evidence(
            prim=self.animation.prim,
            scheme=self.name,
            n_words=self.scheme.n_words,
            times=self.animation.times[list(frames)],
            variants=kept,
            tracked=self.animation.constant_topology,
            bit_threshold=self._bit_threshold,
            part=self.candidate.part,
            also=self.candidate.also,
        )

    def release(self) -> None:
        """Give up what is kept of the reference frame; it is read again when it is needed."""
        self._kept = None

    def _reference_at(self, index: int) -> Reference:
        if self._kept is None:
            self._kept = Reference(self.animation, index)
        return self._kept

    def _measured(
        self, observer: Observer, frames: Sequence[int]
    ) -> Iterator[Observations | InputError]:
        """Measure frames, in worker processes where there is enough for them to do."""
        n = len(observer.restorations)
        if self._pace is None:
            start = time.process_time()
            yield observer(frames[0])
            self._pace = (time.process_time() - start) / n
            frames = frames[1:]
        yield from ordered_map(observer, frames, jobs=self.jobs, seconds=n * self._pace)

    def _readable(self, frames: Sequence[int]) -> list[int]:
        """Leave out the frames that could not be read.

        Raises
        ------
        InputError
            If that is all of them; the first one's reason.
        """
        kept = [t for t in frames if t not in self.unreadable]
        if not kept:
            raise self.unreadable[frames[0]]
        return kept

    def _variant(
        self, frames: Sequence[int], restored: int, reference: Reference
    ) -> RestoredVariant | None:
        numbers = [self._seen[t, restored] for t in frames]
        observations = LazySequence(lambda i: self._spool[numbers[i]], len(numbers))
        if all(observation is None for observation in observations):
            return None
        in_one_order = aligned(observations, self._matcher(reference))
        return RestoredVariant(
            restored=restored,
            log_belief=self._log_belief(restored),
            log_prior=in_one_order.log_prior,
            frames=in_one_order.frames,
        )

    def _keep(self, index: int, restored: int, observation: Observation | None) -> None:
        self._seen[index, restored] = self._spool.add(observation)
        if observation is not None:
            self._bit_threshold = max(self._bit_threshold, observation.bit_threshold)

    def _log_belief(self, restored: int) -> float:
        others = len(self.restorations) - 1
        if others == 0:
            return 0.0
        belief = UNTOUCHED if restored == 0 else (1.0 - UNTOUCHED) / others
        return float(np.log(belief))

    def _matcher(self, reference: Reference) -> Matcher:
        if not self.animation.constant_topology:
            return by_looks
        if self.scheme.follows_vertices:
            # Trajectories keep carriers in one order; matching alike ones could only mix them up.
            return in_order
        return by_place(reference.welding.frame(reference.frame).points)


def extract(
    animation: MeshAnimation,
    scheme: Scheme,
    scheme_name: str,
    *,
    frames: Sequence[int] | None = None,
    jobs: int = 1,
) -> Evidence:
    """Measure the evidence of one mesh.

    Parameters
    ----------
    frames : sequence of int, optional
        Indices of the frames to look at; all by default.

    Raises
    ------
    CapacityError
        If the scheme finds no carrier.
    InputError
        If a frame cannot be read.
    """
    chosen = range(len(animation)) if frames is None else frames
    view = Extraction(animation, scheme, scheme_name, jobs=jobs)
    view.settle(chosen)
    return view.look(view.worth_observing(chosen))
