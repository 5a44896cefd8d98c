"""Marks a file and leaves a manifest: the one call a publish hook needs."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

from meshmark.delivery.unmarked import (
    require_allowed,
    require_extent,
    require_small,
    split_fit,
    split_in_place,
    unasked,
)
from meshmark.detection.gathering import gather
from meshmark.detection.verdict import PrimVerdict, Verdict
from meshmark.detection.verify import judge_all
from meshmark.embedding.asset import MarkedAsset, MarkedMesh, embed
from meshmark.embedding.manifest import FORMAT, Manifest, announced, manifest_path, output_hashes
from meshmark.embedding.outputs import check_output, complete, reread
from meshmark.errors import UsageError
from meshmark.extension.recipe import Recipe
from meshmark.files.atomic import number, write_json
from meshmark.files.locks import held
from meshmark.keys import Key
from meshmark.mesh.asset import Asset
from meshmark.metrics import distortion
from meshmark.recipients import recipient_name
from meshmark.sources.digests import file_hashes, require_unchanged, source_digests
from meshmark.sources.isolation.reading import read_isolated
from meshmark.sources.readers import read, texture_coordinates, writer
from meshmark.version import __version__
from meshmark.workers.ordered_map import sharing_workers
from meshmark.workers.progress import MeshProgress, StageProgress

TARGET_FPR = 1e-6


@sharing_workers
def mark_file(
    source: str | Path,
    output: str | Path,
    key: Key,
    *,
    recipe: Recipe | None = None,
    prims: Sequence[str] = (),
    frames: str | None = None,
    recipient: str | None = None,
    deliver: bool = False,
    allow_unmarked: Sequence[str] = (),
    keep_metadata: bool = False,
    dry_run: bool = False,
    trusted: bool = True,
    jobs: int = 1,
    progress: StageProgress | None = None,
) -> Manifest:
    """Mark a source, write the result and its manifest, and verify what was written.

    Parameters
    ----------
    source : str or Path
        A USD file, a folder or glob of OBJ frames, or anything a reader plugin reads.
    output : str or Path
        Where to: `.usd`, `.usda` or `.usdc` for a layer, or what the source's reader writes.
    key : Key
        The owner's key.
    recipe : Recipe, optional
        Scheme, segmenter, solver and their parameters.
    prims : sequence of str
        Meshes to mark; all that can be where empty.
    frames : str, optional
        Range A:B[:S] of time codes to mark.
    recipient : str, optional
        Whose copy it will be; the manifest has the name in the form of `recipient_name`.
    deliver : bool
        Flatten into one file in which no unmarked point is left.
    allow_unmarked : sequence of str
        Paths of prims that may be delivered unmarked, with all below them; `all` for whatever
        there is. Without it, nothing is delivered of which a mesh was left out, or of which
        those that can hold no mark are more than a tenth.
    keep_metadata : bool
        Deliver comments, authors, paths and whatever else tells of the source's origin, too.
    dry_run : bool
        Do everything but write.
    trusted : bool
        Without it, the source is first read in a process of its own, so that one that crashes or
        hangs the library is told of in one line. The layer is written by this process all the same.
    jobs : int
        Worker processes.
    progress : callable, optional
        Called with (stage, prim, frames done, frames in all).

    Returns
    -------
    Manifest
        As written beside the output. It holds what blind verification says of the written
        file (of the marked frames in memory after a dry run), and the meshes that hold no mark.

    Raises
    ------
    InputError, CapacityError, UsageError, OutputError
        Nothing is written then, unless it is what was written that cannot be verified, or its
        source that changed meanwhile: the manifest says so (see `meshmark.embedding.manifest`).
    """
    if deliver and frames is not None:
        raise UsageError("--deliver with --frames would deliver the other frames unmarked")
    if allow_unmarked and not deliver:
        raise UsageError("--allow-unmarked is for --deliver only")
    if keep_metadata and not deliver:
        raise UsageError("--keep-metadata is for --deliver only")
    target = Path(output)
    recipient = None if recipient is None else recipient_name(recipient)
    recipe = recipe or Recipe()
    original = read(source, prims) if trusted else read_isolated(source, prims, textures=True)
    check_output(target, original, deliver)
    write = writer(original, target, deliver=deliver, keep_metadata=keep_metadata)
    others = unasked(read(source, isolated=not trusted), prims) if deliver and prims else ()
    markable = split_fit(original)
    if deliver:
        require_allowed(markable, allow_unmarked)
        require_extent(markable, allow_unmarked)
    else:
        markable = split_in_place(markable)
    files = source_digests(original)
    with nullcontext() if dry_run else held(target):
        marked = embed(
            markable,
            key,
            recipe=recipe,
            recipient=recipient,
            frames=frames,
            jobs=jobs,
            progress=_stage(progress, "embed"),
        )
        if deliver:
            require_small(markable, marked.skipped, allow_unmarked)
        marked = replace(marked, original=original)
        left_out = (each for each in markable.left_out if deliver or not each.guide)
        skipped = (*marked.skipped, *left_out, *others)
        document: dict[str, Any] = {
            "format": FORMAT,
            "meshmark": __version__,
            "source": _source(original, files, target),
            "output": target.name,
            "delivered": deliver,
            "key_id": key.id,
            "recipient": recipient,
            "frames": frames,
            "plugins": recipe.as_json(),
            "skipped": [{"prim": each.prim, "reason": each.reason} for each in skipped],
        }
        require_unchanged(files)
        with nullcontext() if dry_run else announced(document, target):
            delivery = None if dry_run else write(complete(marked))
            if delivery is not None:
                document["delivery"] = delivery.as_json()
            # Nobody smoothed what was written just now, or joined anything to it.
            evidence = gather(
                marked.asset if dry_run else reread(marked, target),
                recipes=[recipe],
                frames=frames,
                restored=False,
                parts=False,
                jobs=jobs,
                progress=_stage(progress, "verify"),
            )
            recipients = [] if recipient is None else [recipient]
            verdict = judge_all(evidence, key, recipients=recipients, fpr=TARGET_FPR)
            document["prims"] = _prims(marked, verdict, jobs)
            document["verification"] = {
                "verdict": verdict.verdict,
                "log10_p": verdict.log10_p,
                "fpr": TARGET_FPR,
            }
            if dry_run:
                return Manifest(document)
            require_unchanged(files)
            document["output_files"] = output_hashes(target)
            path = manifest_path(target)
            write_json(document, path)
            return Manifest(document, path)


def _source(original: Asset, files: Sequence[tuple[str, str]], target: Path) -> dict[str, Any]:
    folder = target.parent.resolve()
    return {
        "path": Path(os.path.relpath(original.source, folder)).as_posix(),
        "files": file_hashes(files, folder),
    }


def _prims(marked: MarkedAsset, verdict: Verdict, jobs: int) -> list[dict[str, Any]]:
    verdicts = {prim.prim: prim for prim in verdict.prims}
    return [
        _prim(marked.original, mesh, verdicts.get(mesh.animation.prim), jobs)
        for mesh in marked.meshes
    ]


def _prim(asset: Asset, mesh: MarkedMesh, verdict: PrimVerdict | None, jobs: int) -> dict[str, Any]:
    first, chosen = mesh.original[0], mesh.embedded.frames
    uv = texture_coordinates(asset, mesh.original.prim)
    found = distortion(
        mesh.original.select(chosen), mesh.animation.select(chosen), uv=uv, jobs=jobs
    )
    told = None if verdict is None else verdict.as_json()
    kept = ("verdict", "log10_p", "chips", "ber")
    return {
        "prim": mesh.animation.prim,
        "notes": list(mesh.animation.notes),
        "points": first.topology.n_points,
        "faces": len(first.topology.counts),
        "frames": len(mesh.original),
        "marked_frames": len(chosen),
        "passed_over": [
            {"time": number(time), "reason": error.message} for time, error in mesh.passed_over
        ],
        "carriers": mesh.embedded.carriers,
        "distortion": {name: number(value) for name, value in vars(found).items()},
        "verification": None if told is None else {name: told[name] for name in kept},
    }


def _stage(progress: StageProgress | None, stage: str) -> MeshProgress | None:
    if progress is None:
        return None
    return lambda prim, done, total: progress(stage, prim, done, total)
