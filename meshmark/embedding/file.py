"""Marks a file and leaves a manifest: the one call a publish hook needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meshmark.delivery.unmarked import require_held, require_small, split_in_place, unasked
from meshmark.embedding.asset import MarkedAsset, embed
from meshmark.embedding.checks import verify_written
from meshmark.embedding.credentials import require_place, write_sidecar
from meshmark.embedding.description import MeasureMarks, describe_marks, describe_run, record_of
from meshmark.embedding.left_out import markable_of, told_of_skipped, unheld
from meshmark.embedding.manifest import (
    Manifest,
    announced,
    made_before,
    manifest_path,
    output_hashes,
    require_unmarked,
)
from meshmark.embedding.options import require_sensible
from meshmark.embedding.outputs import check_output, master_keeper, places_together
from meshmark.embedding.undoing import as_they_were
from meshmark.errors import UsageError
from meshmark.extension.recipe import Recipe, in_order
from meshmark.files.atomic import write_json
from meshmark.files.locks import held
from meshmark.keys import Key
from meshmark.mesh.asset import Asset, LeftOut
from meshmark.recipients import recipient_name
from meshmark.sources.digests import require_unchanged, source_digests
from meshmark.sources.isolation.reading import read_isolated
from meshmark.sources.reading import read
from meshmark.sources.writing import read_back, writer
from meshmark.usd.names import BAKE, FOLLOW, READER
from meshmark.usd.reader import UsdReader
from meshmark.usd.stamp import Stamp
from meshmark.workers.ordered_map import Workers, sharing_workers
from meshmark.workers.progress import MeshProgress, StageProgress

if TYPE_CHECKING:
    from meshmark.c2pa.signing import Signer


@sharing_workers
def mark_file(
    source: str | Path,
    output: str | Path,
    key: Key,
    *,
    recipe: Recipe | Sequence[Recipe] | None = None,
    prims: Sequence[str] = (),
    parameters: Mapping[str, Any] | None = None,
    frames: str | None = None,
    recipient: str | None = None,
    master: str | Path | None = None,
    deliver: bool = False,
    allow_unmarked: Sequence[str] = (),
    keep_metadata: bool = False,
    skel: str = BAKE,
    stamp: bool = False,
    primvars: str = FOLLOW,
    check_all: bool = False,
    dry_run: bool = False,
    record: Callable[[dict[str, Any]], object] | None = None,
    signer: Signer | None = None,
    trusted: bool = True,
    jobs: int = 1,
    progress: StageProgress | None = None,
) -> Manifest:
    """Mark a source, write the result and its manifest, and verify what was written.

    An output that the same call has made of the same files is left as it is, unless a master is
    to be written, too.

    Parameters
    ----------
    source : str or Path
        A USD file, a folder or glob of OBJ frames, or anything a reader plugin reads.
    output : str or Path
        Where to: `.usd`, `.usda` or `.usdc` for a layer, or what the source's reader writes.
    key : Key
        The owner's key.
    recipe : Recipe or sequence of Recipe, optional
        Schemes with their parameters, a layer each; `default_layers` where not given.
    prims : sequence of str
        Meshes to mark; all that can be where empty.
    parameters : mapping, optional
        Of the source's reader, as `meshmark.read` takes them; the manifest records them.
    frames : str, optional
        Range A:B[:S] of time codes to mark.
    recipient : str, optional
        Whose copy it will be; the manifest has the name in the form of `recipient_name`.
    master : str or Path, optional
        Where to keep the source as the blind layers left it, in the same form as the output:
        `verify` otherwise has to make it again.
    deliver : bool
        Flatten into one file in which no unmarked point is left.
    allow_unmarked : sequence of str
        Paths of prims that may be delivered unmarked, with all below them; `all` for whatever
        there is. Without it, nothing is delivered of which a mesh was left out, or of which
        those that can hold no mark are more than a tenth.
    keep_metadata : bool
        Deliver comments, authors, paths and whatever else tells of the source's origin, too.
    skel : {"bake", "rest"}
        What becomes of rigged meshes of a stage: their posed, marked points are written and their
        rigs taken off; or the rig stays, and its rest pose becomes the one that it poses like the
        marked points, as nearly as it can.
    stamp : bool
        Apply the schema `MeshmarkAPI` to the marked meshes of a stage: it says that they are
        marked, by which schemes, and the record that the manifest has.
    primvars : {"follow", "keep"}
        What becomes of texture coordinates, colours, normals and the like on points of a stage
        that slid: they get the values of their new places, or keep their own.
    check_all : bool
        Compare and verify all frames of what was written. By default it is a few, spread over the
        animation; all are compared, too, if those leave it in doubt whether the limit to the
        distortion is kept.
    dry_run : bool
        Do everything but write.
    record : callable, optional
        Called with the manifest when all is in place. Where it is given, all is put back as it
        was if it raises, or anything before it does.
    signer : Signer, optional
        Signs a C2PA sidecar beside the output. Output and sidecar are there both, or as before.
    trusted : bool
        Without it, the source is first read in a process of its own, so that one that crashes or
        hangs the library is told of in one line. The layer is written by this process all the same.
    jobs : int
        Processes that work, this one among them.
    progress : callable, optional
        Called with (stage, prim, frames done, frames in all).

    Returns
    -------
    Manifest
        As written beside the output. It holds what verification says of the written
        file (of the marked frames in memory after a dry run), and the meshes that hold no mark.

    Raises
    ------
    InputError, CapacityError, UsageError, OutputError
        Nothing is written then, unless it is what was written that cannot be verified, or its
        source that changed meanwhile: the manifest says so (see `meshmark.embedding.manifest`).
    """
    require_sensible(deliver, frames, allow_unmarked, keep_metadata, skel, primvars)
    target, layers = Path(output), in_order(recipe)
    recipient = None if recipient is None else recipient_name(recipient)
    require_unmarked(Path(source), key.id)
    original = _original(source, prims, parameters, trusted)
    check_output(target, original, deliver)
    if signer is not None:
        require_place(target, original)
    if stamp and not UsdReader().writes(target):
        raise UsageError("--stamp is for USD files only", source=target)
    write = writer(
        original,
        target,
        parameters=parameters,
        deliver=deliver,
        keep_metadata=keep_metadata,
        skel=skel,
        primvars=primvars,
    )
    keep = master_keeper(master, original, target, parameters, layers, skel, primvars)
    others: Sequence[LeftOut] = ()
    if deliver and prims:
        others = unasked(read(source, parameters=parameters, isolated=not trusted), prims)
    markable = markable_of(original, deliver, allow_unmarked)
    if not deliver and original.reader == READER and UsdReader().writes(target):
        # Whatever cannot be written is told of before all the work.
        places = UsdReader().places(markable)
        markable = split_in_place(markable, places.found)
        write = partial(write, places=places)
    files = source_digests(original)
    document = describe_run(
        original,
        files,
        target,
        key=key,
        parameters=parameters,
        layers=layers,
        recipient=recipient,
        frames=frames,
        deliver=deliver,
        skel=skel,
        primvars=primvars,
        asked={
            "prims": list(prims),
            "allow_unmarked": list(allow_unmarked),
            "keep_metadata": keep_metadata,
            "stamp": stamp,
            "check_all": check_all,
            **({} if signer is None else {"certificate": signer.certificate}),
        },
    )
    check = partial(
        _check,
        key=key,
        layers=layers,
        recipient=recipient,
        primvars=primvars,
        check_all=check_all,
        jobs=jobs,
        progress=_stage(progress, "verify"),
    )
    with nullcontext() if dry_run else held(target):
        if not (dry_run or master) and (before := made_before(document, target)):
            if record is not None:
                record(before.document)
            return before
        marked = embed(
            markable,
            key,
            recipe=layers,
            recipient=recipient,
            frames=frames,
            jobs=jobs,
            progress=_stage(progress, "embed"),
        )
        if deliver:
            require_small(markable, marked.skipped, allow_unmarked)
            require_held(markable, unheld(marked), allow_unmarked)
        marked = replace(marked, original=original)
        document["skipped"] = told_of_skipped(marked, markable, others, deliver)
        if stamp or signer is not None:
            document["record"] = record_of(document, marked, key)
        if stamp:
            write = partial(write, stamps=_stamps(marked, document["record"]))
        require_unchanged(files)
        if dry_run:
            return Manifest(document | check(marked.asset, marked))
        together = places_together(target, master, record, signer)
        with as_they_were(together) as undoing, announced(document, target):
            done = write(marked.asset)
            document |= {} if done is None else done.as_json()
            held_by = [mesh.original.prim for mesh in marked.meshes]
            document |= check(read_back(original, target, held_by, parameters), marked)
            keep(marked.master)
            require_unchanged(files)
            document["output_files"] = output_hashes(target)
            if signer is not None:
                document["c2pa"] = write_sidecar(document, target, signer)
            write_json(document, manifest_path(target))
            if record is not None:
                undoing.settle(partial(record, document))
            return Manifest(document, manifest_path(target))


def _original(
    source: str | Path, prims: Sequence[str], parameters: Mapping[str, Any] | None, trusted: bool
) -> Asset:
    if trusted:
        return read(source, prims, parameters=parameters)
    return read_isolated(source, prims, parameters=parameters, textures=True)


def _stamps(marked: MarkedAsset, record: str) -> dict[str, Stamp]:
    return {
        mesh.original.prim: Stamp(record, tuple(layer.scheme for layer in mesh.layers))
        for mesh in marked.meshes
    }


def _check(
    written: Asset,
    marked: MarkedAsset,
    *,
    key: Key,
    layers: Sequence[Recipe],
    recipient: str | None,
    primvars: str,
    check_all: bool,
    jobs: int,
    progress: MeshProgress | None,
) -> dict[str, Any]:
    """Verify what was written, measure its distortion meanwhile, and tell of both."""
    measure = MeasureMarks.of(marked, written, layers, primvars=primvars, check_all=check_all)
    with Workers(measure, jobs) as workers:
        beside = workers.are_ready
        distortions = workers.begin(1 if beside else jobs)
        verdict = verify_written(
            written,
            marked,
            key,
            layers,
            recipient=recipient,
            check_all=check_all,
            jobs=jobs - 1 if beside else jobs,
            progress=progress,
        )
        return describe_marks(marked, verdict, distortions(), layers=layers, check_all=check_all)


def _stage(progress: StageProgress | None, stage: str) -> MeshProgress | None:
    if progress is None:
        return None
    return lambda prim, done, total: progress(stage, prim, done, total)
