"""Schemes that read a copy beside its original: what they get, and what they must do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import BoolArray, FloatArray, IntArray, SignArray
from meshmark.errors import CapacityError
from meshmark.extension.carrier import Observation
from meshmark.extension.interfaces import MarkingPlan
from meshmark.keys import Key
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.welding import Welding

# Vertices that a `VertexReader` may tell of.
MOST_VERTICES = 1 << 14


@dataclass(frozen=True, eq=False)
class AlignedFrame:
    """One frame of a copy in the space of its reference.

    Parameters
    ----------
    reference : Frame
        The original, or the master, in the copy's pose: N vertices as analysis sees them, in the
        polygons of the file.
    motion : (N, 3) float64
        Its velocity, per frame; 0 where it does not move.
    points : (n, 3) float64
        The copy's vertices.
    normals : (n, 3) float64
        Their unit normals.
    vertices : (n,) int or None
        Vertex of the reference that each of them is, where they kept their identity.
    """

    reference: Frame
    motion: FloatArray
    points: FloatArray
    normals: FloatArray
    vertices: IntArray | None = None


class InformedLayout(Protocol):
    """Where an informed scheme puts its chips on one original.

    Chips that are not the owner's in every copy hold a recipient's word, if there is one.
    """

    @property
    def n_chips(self) -> int:
        """K."""
        ...

    @property
    def owner(self) -> BoolArray:
        """Which chips hold the owner's word, whoever the copy is for."""
        ...


@runtime_checkable
class InformedScheme(Protocol):
    """Marks any mesh, and reads a copy against the original. No key is involved but in `plan`."""

    def layout(self, original: Frame) -> Any:
        """Lay out the chips on a frame of the original, as analysis sees it.

        The same for the same frame, always: it is made when marking, and again when reading.

        Returns
        -------
        InformedLayout

        Raises
        ------
        CapacityError
            If the mesh is too small.
        """
        ...

    def plan(
        self, animation: MeshAnimation, layout: Any, signs: SignArray, *, jobs: int
    ) -> MarkingPlan:
        """Decide how all frames of an animation, as analysis sees them, are to be marked.

        Parameters
        ----------
        signs : (K,) int
            One of +1 and -1 for each chip.
        """
        ...

    def treatment(self, views: Sequence[AlignedFrame]) -> Any:
        """Find out from one frame what a program did to the copy's surface; it must pickle.

        Parameters
        ----------
        views : sequence of AlignedFrame
            The frame under each map that may lay it upon its reference.
        """
        ...

    def measure(self, view: AlignedFrame, treatment: Any) -> Any:
        """Measure one frame of a copy under one map; the result must pickle.

        Without the layout: workers, which measure frames, need not make it.

        Parameters
        ----------
        treatment
            What `treatment` found out from one of the copy's frames; or None of a copy that is
            known to be as it was written, vertex by vertex.
        """
        ...

    def observe(self, measured: Sequence[Any], layout: Any) -> list[Observation]:
        """Estimate the chips from what was measured of all frames under one map.

        Returns
        -------
        list of Observation
            One for each frame: evidence (R, 1, K) under the same R hypotheses. Their mean is what
            all frames say together.
        """
        ...


@runtime_checkable
class VertexReader(Protocol):
    """What an `InformedScheme` may offer, too: to tell which copies single vertices came from.

    Copies of several recipients may be made into one that takes each vertex from one of them.
    """

    def vertex_steps(
        self, measured: Sequence[Sequence[Any]], layout: Any
    ) -> NDArray[np.int16] | None:
        """Boil down what was measured of single vertices: all that is kept for later keys.

        Parameters
        ----------
        measured : sequence of sequences
            Of all frames, under each map.

        Returns
        -------
        (V,) int16, or None if there is nothing to tell; V at most `MOST_VERTICES`.
        """
        ...

    def vertex_fits(
        self, steps: NDArray[np.int16], layout: Any, signs: SignArray, decoys: SignArray
    ) -> FloatArray:
        """Tell how well the chips of recipients fit that, one part of them after the other.

        Parameters
        ----------
        signs : (n, K) int
            Chips of n recipients' copies, the owner's included.
        decoys : (M, K) int
            Random chips. In one part at a time they stand in for a recipient's.

        Returns
        -------
        (B, n, 1 + M) float64
            Log of any fit, of each part's own chips, then of the decoys'. It may depend on the
            owner's chips and on the recipient's in parts before it, never in later ones: see
            `meshmark.statistics.decoys`.
        """
        ...


def signs_of(
    key: Key, scheme_name: str, layout: InformedLayout, recipient: str | None
) -> SignArray:
    """Derive the sign of each chip, (K,) int8: the owner's, and the recipient's if there is one."""
    names = (None,) if recipient is None else (None, recipient)
    words = key.words_of(scheme_name, 1, layout.n_chips, names)[:, 0]
    return np.where(layout.owner, words[0], words[-1])


def layout_frame(original: MeshAnimation) -> tuple[Welding, Frame]:
    """Return the frame that chips are laid out on, and the welding it is seen through.

    Raises
    ------
    CapacityError
        If no frame has a surface; the first one's reason.
    """
    first: CapacityError | None = None
    for frame in original:
        try:
            welding = Welding.of(frame)
        except CapacityError as error:
            first = first or error
        else:
            return welding, welding.frame(frame)
    assert first is not None
    raise first
