"""What a reader, segmenter, solver, scheme and attack must be able to do."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.extension.carrier import Carrier, Observation
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.asset import Asset


@runtime_checkable
class Reader(Protocol):
    """Reads one kind of source into an `Asset`, and may write it back.

    This is what it must have. It may have `files`, `files_in_reach`, `texture_coordinates`,
    `require_writable` and `written_names` of `SourceReader`, too; and `write_new(asset, output)`,
    which makes a new file of an asset of any reader.
    """

    def accepts(self, source: str) -> bool:
        """Tell, from the name and a glance at the folder, whether this reader is meant."""
        ...

    def read(self, source: str) -> Asset:
        """Read every mesh of the source; frames may be read lazily.

        Raises
        ------
        InputError
            Naming file, mesh and frame, if the source cannot be read.
        """
        ...

    def writes(self, output: Path) -> bool:
        """Tell whether `output` names something this reader can write back to."""
        ...

    def write(self, marked: Asset, original: Asset, output: Path) -> None:
        """Write `original`, as it stands in its files, with the points of `marked`.

        Nothing but positions may change, and nothing half-written may be left behind. Where
        frames follow from positions at rest, these are to come as near to the frames as they can.
        """
        ...


class SourceReader(Reader, Protocol):
    """All that is asked of a reader; what a plugin's leaves out, the core does its own way."""

    @property
    def name(self) -> str:
        """What it is called."""
        ...

    def read(self, source: str, prims: Sequence[str] = ()) -> Asset:
        """Read the meshes named, or every mesh of the source."""
        ...

    def files(self, source: str) -> list[Path]:
        """List the files the source consists of, sorted.

        They are hashed. Without it, they are all files of a folder, or those of a pattern.
        """
        ...

    def files_in_reach(self, source: str) -> list[Path]:
        """List every file the source could use, whatever is selected; none if it is missing.

        They are never written to. Without it, they are the files of a folder, or of a pattern.
        """
        ...

    def texture_coordinates(self, source: str, prim: str) -> FloatArray | None:
        """Read the texture coordinates of a mesh, if it has any and the reader reads them.

        Returns
        -------
        (F, 3, 2) float64 or None
            For each corner of each triangle.
        """
        ...

    def require_writable(self, source: str, output: Path) -> None:
        """Refuse, with a `UsageError`, a source that cannot be written back to an output.

        Asked before any work is done. Without it, none is refused.
        """
        ...

    def written_names(self, original: Asset) -> dict[str, str]:
        """Map the name of each mesh of an asset to its name in what `write` makes of it."""
        ...


@runtime_checkable
class Segmenter(Protocol):
    """Cuts a mesh into parts."""

    def segment(self, V: FloatArray, F: IntArray) -> IntArray:
        """Label each face with its part.

        Parameters
        ----------
        V : (N, 3) float64
            Vertex positions.
        F : (F, 3) int
            Triangles.

        Returns
        -------
        (F,) int
            Part of each face, 0-based, every part edge-connected. The same for a mesh that
            was rotated, scaled, moved or re-ordered (up to the re-ordering), and on every run.
        """
        ...


@runtime_checkable
class GeodesicSolver(Protocol):
    """Built once on a mesh, asked many times."""

    def distances(self, sources: IntArray) -> FloatArray:
        """Measure the distance along the surface from each source to every vertex.

        Parameters
        ----------
        sources : (S,) int
            Vertex indices.

        Returns
        -------
        (S, N) float64
            Distances in the unit of the points; inf where a vertex cannot be reached.
        """
        ...


class MarkingPlan(Protocol):
    """How a scheme will mark one animation; must pickle, for worker processes."""

    @property
    def carriers(self) -> int:
        """Number of carriers it marks."""
        ...

    def mark(self, index: int, frame: Frame) -> FloatArray:
        """Return the marked positions (N, 3) of frame `index` of the planned animation.

        No face may turn over: see `meshmark.mesh.flip_guard`.
        """
        ...


@runtime_checkable
class Scheme(Protocol):
    """Observes each frame by itself, and marks all frames by one plan.

    Where binned carriers and moves say all about a scheme, a `BinnedScheme` is less work: the
    closed loop that drives it is the core's.

    Attributes
    ----------
    n_chips : int
        Chips of one carrier.
    n_words : int
        Code words, each for a carrier of its own.
    restorations : tuple of int
        Iterations of umbrella smoothing that are worth undoing before a look, 0 first.
    follows_vertices : bool
        Whether carriers are found in `reference` and followed along vertex trajectories, where
        all frames share a topology. They then have the same order in every frame, and frames
        that are blends of their neighbours are observed like the others.
    """

    n_chips: int
    n_words: int
    restorations: tuple[int, ...]
    follows_vertices: bool

    def observe(self, frame: Frame, reference: Frame | None = None) -> Observation:
        """Measure a frame alone: every carrier, under every hypothesis.

        Parameters
        ----------
        frame : Frame
            As analysis sees it.
        reference : Frame, optional
            A frame of the same mesh, the same for all that are measured: what depends on the
            size of the mesh is taken from it, so that hypotheses mean the same in every pose.

        Raises
        ------
        NoLayoutError
            If there is no carrier in `reference`, and therefore in no frame.
        CapacityError
            If there is no carrier in this frame.
        """
        ...

    def require_capacity(self, animation: MeshAnimation, *, jobs: int) -> None:
        """Look, without a key, whether an animation could be marked.

        Raises
        ------
        CapacityError
            If it could not, with the reason and what to do.
        """
        ...

    def plan(
        self,
        animation: MeshAnimation,
        words: IntArray,
        *,
        generator: np.random.Generator,
        step: float,
        jobs: int,
    ) -> MarkingPlan:
        """Decide how all frames of an animation of one topology are to be marked.

        Parameters
        ----------
        words : (n_words, n_chips) int
            The key's code words; which carrier takes which, `observe` must be able to tell.
        generator : numpy.random.Generator
            Seeded by the key, for what is chosen at random.
        step : float
            What coordinates are rounded to where they are stored: a move is whole steps long.
        jobs : int
            Worker processes that may be used.

        Raises
        ------
        CapacityError
            If the mesh is too small or too featureless, with the reason and what to do.
        """
        ...


@runtime_checkable
class BinnedScheme(Protocol):
    """Says where the carriers come from, and how vertices move. All else is the core's.

    `meshmark.extension.binned_scheme` makes a `Scheme` of it.

    Attributes
    ----------
    n_chips : int
        Chips of one carrier.
    n_words : int
        Code words: 1 if all carriers share one; otherwise each carrier holds a different one.
    strength : float
        Target of a chip: embedding drives w s up to at least this, s as measured.
    rehearsal : int
        Iterations of umbrella smoothing the closed loop rehearses; 0 for none. A chip is then
        pushed until enough of it would be left.
    propagate : str
        "adapt" if every frame is driven to its own targets; "delta" if `carry` takes the
        first frame's moves to the others.
    """

    n_chips: int
    n_words: int
    strength: float
    propagate: str
    rehearsal: int

    def layout(self, frame: Frame) -> Any:
        """Find in the first frame what vertex trajectories carry to the others.

        The result must pickle; it is handed back with every frame of the same topology.

        Raises
        ------
        CapacityError
            If the mesh is too small or too featureless.
        """
        ...

    def carriers(self, frame: Frame, layout: Any) -> Sequence[Carrier]:
        """Measure the carriers of a frame: which vertices, which coordinate, which bins.

        Always as many, and in the same order, for one layout.
        """
        ...

    def move(
        self,
        frame: Frame,
        layout: Any,
        carriers: Sequence[Carrier],
        shifts: Sequence[FloatArray],
        rng: np.random.Generator,
    ) -> FloatArray:
        """Move vertices so that each chip changes by about its shift.

        Parameters
        ----------
        shifts : sequence of (n_chips,) float64
            Wanted change of each chip of each carrier; 0 where nothing is wanted.
        rng : numpy.random.Generator
            Seeded by the key, equal for every frame.

        Returns
        -------
        (N, 3) float64
            New vertex positions.
        """
        ...

    def carry(
        self, frame: Frame, layout: Any, reference: Frame, marked: Frame, words: IntArray
    ) -> FloatArray:
        """Take the moves of the first frame to another (`propagate` = "delta").

        Parameters
        ----------
        reference, marked : Frame
            The first frame before and after.
        words : (carriers, n_chips) int
            The code word, +-1, each carrier was marked with.
        """
        ...


@runtime_checkable
class Attack(Protocol):
    """Treats an animation as a thief, a pipeline or an accident would."""

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the attacked animation; the given one is left alone."""
        ...
