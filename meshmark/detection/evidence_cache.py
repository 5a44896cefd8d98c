"""Measures a source's evidence once, and keeps it for later keys: in a file, or in a store."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from meshmark.detection.evidence import Evidence
from meshmark.detection.evidence_file import StoredEvidence, load_evidence, save_evidence
from meshmark.detection.gathering import AssetEvidence, gather
from meshmark.detection.informed import beside_original, gather_informed
from meshmark.detection.looks import EVERYTHING, Look
from meshmark.errors import InputError, UsageError
from meshmark.extension.recipe import Recipe, default_layers
from meshmark.mesh.asset import Asset
from meshmark.mesh.frame_range import AUTO
from meshmark.sources.digests import file_hashes, source_digests
from meshmark.sources.facts import source_files
from meshmark.sources.readers import parameters_for
from meshmark.sources.reading import read
from meshmark.version import __version__
from meshmark.workers.progress import MeshProgress


class Keeper(Protocol):
    """What keeps evidence of sources."""

    @property
    def look(self) -> Look:
        """How much of a source is measured where that is not told."""
        ...

    @property
    def authenticated(self) -> bool:
        """Whether it is known where what is kept was measured."""
        ...

    def find(self, wanted: StoredEvidence, source: str) -> StoredEvidence | None:
        """Return the evidence of a source that is described, if it is kept."""
        ...

    def add(self, stored: StoredEvidence) -> StoredEvidence:
        """Keep evidence, and return it as it is kept."""
        ...


@dataclass(frozen=True)
class EvidenceFile:
    """A file that keeps the evidence of one source.

    Parameters
    ----------
    path : Path
    authenticated : bool
        Whether the file must bear the seal of the local secret. Without, it must exist, and no
        verdict rests on it.
    """

    path: Path
    authenticated: bool = True

    @property
    def look(self) -> Look:
        """Everything."""
        return EVERYTHING

    def find(self, wanted: StoredEvidence, source: str) -> StoredEvidence | None:
        """Read the file, if it is there.

        Raises
        ------
        UsageError
            If it holds evidence of another source, or of other schemes, frames or parameters.
        """
        if self.authenticated and not self.path.exists():
            return None
        stored = load_evidence(self.path, authenticated=self.authenticated)
        _require_same(stored, wanted, source, self.path)
        return stored

    def add(self, stored: StoredEvidence) -> StoredEvidence:
        """Write the file; it may be handed on, and does not say where the source was."""
        save_evidence(replace(stored, path=""), self.path)
        return stored


def kept_evidence(
    source: str,
    keeper: Keeper,
    *,
    recipes: Sequence[Recipe] = (),
    frames: str | None = None,
    parameters: Mapping[str, Any] | None = None,
    isolated: bool = False,
    original: str | None = None,
    master: str | None = None,
    jobs: int = 1,
    progress: MeshProgress | None = None,
) -> AssetEvidence:
    """Read the evidence of a source from where it is kept; where it is not, measure and keep it.

    Parameters
    ----------
    source : str
        As `meshmark.read` takes it.
    keeper : Keeper
        Keeps it: an `EvidenceFile`, or an `EvidenceStore`.
    recipes : sequence of Recipe
        Schemes with their parameters; all there are, with their defaults, where empty. Informed
        ones only count with an original.
    frames : str, optional
        Range A:B[:S] of time codes, all by default; or "auto", for as many as the keeper asks for.
    parameters : mapping, optional
        Of the readers of source, original and master: each gets those that it takes.
    isolated : bool
        Read the source in a process of its own, as `meshmark.read` can.
    original, master : str, optional
        What to measure the source beside, too; see `meshmark.detection.verify.verify`.

    Raises
    ------
    UsageError
        If an evidence file holds that of another source, or of other schemes, frames or parameters.
    InputError
        If the source or the file cannot be read, if the file is not authentic, or if the source
        changed while it was measured.
    """
    start = time.perf_counter()
    tried = tuple(recipes) or default_layers()
    blind = tuple(recipe for recipe in tried if not recipe.informed)
    informed = tuple(recipe for recipe in tried if recipe.informed and original is not None)
    if not blind and not informed:
        raise UsageError(f"scheme {tried[0].scheme} reads a copy beside its original only")
    # Of a source that was read apart all is read, and known to be what was hashed.
    states = [] if isolated else _states(source)
    given = dict(parameters or {})

    def read_with(name: str, *, copy: bool) -> Asset:
        return read(name, parameters=parameters_for(name, given, copy=copy), isolated=isolated)

    asset = read_with(source, copy=original is not None)
    names = [name for name in (original, master) if name is not None]
    beside = [read_with(name, copy=name != original) for name in names]
    files = source_digests(asset)
    wanted = StoredEvidence(
        files=_relative(files, asset),
        original=tuple(pair for each in beside for pair in _relative(source_digests(each), each)),
        recipes=[recipe.as_json() for recipe in (*blind, *informed)],
        frames=_frames_told(frames, keeper.look),
        items=(),
        notes=(),
        parameters=given,
        # Names of files need not be text.
        path=str(Path(source).absolute()).encode(errors="replace").decode(),
        version=__version__,
    )
    stored = keeper.find(wanted, source)
    if stored is None:
        items: tuple[Evidence, ...] = ()
        notes: tuple[str, ...] = ()
        if blind:
            alone = gather(
                asset,
                recipes=blind,
                frames=frames,
                look=keeper.look if frames == AUTO else EVERYTHING,
                jobs=jobs,
                progress=progress,
            )
            items, notes = alone.items, alone.notes
        if informed:
            read_beside = gather_informed(
                asset,
                beside[0],
                informed,
                master=beside[1] if len(beside) > 1 else None,
                frames=frames,
                jobs=jobs,
                progress=progress,
            )
            items, notes = (*items, *read_beside.items), (*notes, *read_beside.notes)
        if states and _states(source) != states:
            raise InputError("changed while it was measured; measure it again", source=source)
        stored = keeper.add(replace(wanted, items=items, notes=notes))
    return AssetEvidence(
        source,
        beside_original(stored.items, beside[0], informed) if informed else stored.items,
        len(blind),
        stored.notes,
        time.perf_counter() - start,
        keeper.authenticated,
        original,
        files,
    )


def _frames_told(frames: str | None, look: Look) -> str | None:
    """Name frames in one way: None are all."""
    everything = frames == ":" or (frames == AUTO and look == EVERYTHING)
    return None if everything else frames


def _states(source: str) -> list[tuple[object, ...]]:
    """Tell files from what they were: whatever is written or exchanged gets another time."""
    files = source_files(source)
    try:
        states = [file.stat() for file in files]
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", source=error.filename) from None
    return [
        (file, s.st_ino, s.st_size, s.st_mtime_ns, s.st_ctime_ns)
        for file, s in zip(files, states, strict=True)
    ]


def _relative(files: Sequence[tuple[str, str]], asset: Asset) -> tuple[tuple[str, str], ...]:
    hashes = file_hashes(files, Path(asset.source).resolve().parent)
    return tuple((item["file"], item["sha256"]) for item in hashes)


def _require_same(stored: StoredEvidence, wanted: StoredEvidence, source: str, path: Path) -> None:
    # A copy under another name is the same copy.
    if [digest for _, digest in stored.files] != [digest for _, digest in wanted.files]:
        raise UsageError(f"{path} holds the evidence of another file", source=source)
    if [digest for _, digest in stored.original] != [digest for _, digest in wanted.original]:
        raise UsageError(f"{path} was measured beside another original", source=source)
    if list(stored.recipes) != list(wanted.recipes):
        names = ", ".join(str(recipe["scheme"]["name"]) for recipe in stored.recipes)
        raise UsageError(
            f"{path} holds evidence of other schemes or parameters (schemes: {names}); give the "
            "same --scheme and --set, or another file",
            source=source,
        )
    if dict(stored.parameters) != dict(wanted.parameters):
        told = ", ".join(f"{name} {value}" for name, value in stored.parameters.items())
        raise UsageError(
            f"{path} holds evidence of another clip, frame rate or variant: {told or 'none given'}",
            source=source,
        )
    if stored.frames != wanted.frames:
        kept = stored.frames or "all"
        raise UsageError(f"{path} holds evidence of other frames: {kept}", source=source)
