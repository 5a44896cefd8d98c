"""Measures frames: each as it stands and restored, beside the one the others are compared with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from meshmark.detection.evidence import in_steps
from meshmark.detection.reference_frame import readable
from meshmark.detection.unsmoothing import unsmoothed
from meshmark.errors import CapacityError, InputError, NoLayoutError
from meshmark.extension.carrier import Observation
from meshmark.extension.interfaces import Scheme
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.breakdown import breakdown_means_no_capacity
from meshmark.mesh.welding import Welding

# One for each restoration; None where nothing is found.
Observations = tuple[Observation | None, ...]


@dataclass(frozen=True, eq=False)
class Reference:
    """The frame that the others are compared with; read when it is needed, and then only once.

    Parameters
    ----------
    animation : MeshAnimation
        The copy.
    index : int
        Its frame.
    """

    animation: MeshAnimation
    index: int

    @cached_property
    def frame(self) -> Frame:
        """The frame as it stands."""
        return readable(self.animation, self.index)

    @cached_property
    def welding(self) -> Welding:
        """The mesh as analysis sees it, in all frames that share its topology."""
        return Welding.of(self.frame)

    @cached_property
    def analysed(self) -> Frame:
        """The frame as it stands, as analysis sees it."""
        return self.welding.frame(self.frame)

    @cached_property
    def _restored(self) -> dict[int, Frame]:
        return {0: self.analysed}

    def restored(self, counts: Sequence[int]) -> dict[int, Frame]:
        """Return it with smoothing undone, as analysis sees it, for some counts of iterations."""
        new = [n for n in counts if n not in self._restored]
        for n, frame in zip(new, unsmoothed(self.frame, new), strict=True):
            seen = self.welding.frame(frame)
            self._restored[n] = replace(seen, as_found=self.analysed)
        return {n: self._restored[n] for n in counts}


@dataclass(frozen=True, eq=False)
class Observer:
    """Measures frame after frame of an animation, each as it stands and restored.

    Parameters
    ----------
    reference : Reference
        Frame of the copy that the others are compared with, where all share its topology.
    scheme : Scheme
        What is measured.
    restorations : tuple of int
        Iterations of smoothing to undo; 0 for the frame as it stands.
    """

    reference: Reference
    scheme: Scheme
    restorations: tuple[int, ...]

    @cached_property
    def references(self) -> dict[int, Frame]:
        """The reference frame as it stands and restored, where all frames share its topology.

        Raises
        ------
        CapacityError
            If there is nothing to analyse in it; NoLayoutError if no frame is analysed then.
        """
        if not self.reference.animation.constant_topology:
            return {}
        try:
            return self.reference.restored(self.restorations)
        except CapacityError as error:
            raise (
                NoLayoutError(error.message) if self.scheme.follows_vertices else error
            ) from None

    def __call__(self, index: int) -> Observations | InputError:
        """Measure frame `index` under every restoration; None where nothing is found.

        A frame that cannot be read gives the reason.
        """
        reference = self.reference
        here = index == reference.index
        try:
            frame = reference.frame if here else readable(reference.animation, index)
        except InputError as error:
            return error
        except CapacityError:
            return (None,) * len(self.restorations)
        if here and reference.animation.constant_topology:
            return tuple(_compact(self._observe(None, n)) for n in self.restorations)
        restored = zip(self.restorations, unsmoothed(frame, self.restorations), strict=True)
        return tuple(_compact(self._observe(frame, n)) for n, frame in restored)

    def _observe(self, frame: Frame | None, restored: int) -> Observation | None:
        """Observe a frame, or the reference itself."""
        try:
            with breakdown_means_no_capacity():
                reference = self.references.get(restored)
                if reference is None:
                    assert frame is not None
                    return self.scheme.observe(Welding.of(frame).frame(frame))
                seen = reference if frame is None else self.reference.welding.frame(frame)
                return self.scheme.observe(seen, reference)
        except NoLayoutError:
            # What the reference lacks, all frames lack.
            raise
        except CapacityError:
            return None


def _compact(observation: Observation | None) -> Observation | None:
    """Keep evidence in the steps it is judged in: of long animations there is much."""
    return observation and replace(observation, soft=in_steps(observation.soft))
