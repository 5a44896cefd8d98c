"""`meshmark embed`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from meshmark.cli.console import frame_progress, put_json, say
from meshmark.cli.ledger import Recorder
from meshmark.cli.marks import tell_meshes, tell_remarks
from meshmark.cli.options import (
    ClipOption,
    FpsOption,
    FramesOption,
    GeodesicOption,
    JsonOption,
    KeyOption,
    OutputOption,
    PrimOption,
    SegmenterOption,
    SetOption,
    SourceArgument,
    TrustedOption,
    VariantOption,
    load_key,
    reader_parameters,
)
from meshmark.cli.repeating import typed_command
from meshmark.extension.defaults import DEFAULT_GEODESIC, DEFAULT_LAYERS, DEFAULT_SEGMENTER
from meshmark.usd.names import BAKE, FOLLOW

if TYPE_CHECKING:
    from meshmark.c2pa.signing import Signer

NOT_ALL_MARKED = 1


def embed(
    context: typer.Context,
    source: SourceArgument,
    output: OutputOption,
    key: KeyOption,
    scheme: Annotated[
        list[str],
        typer.Option(
            help="Watermarking scheme; several are laid upon each other, blind ones first."
        ),
    ] = list(DEFAULT_LAYERS),  # noqa: B006 (typer makes a new list each time)
    segmenter: SegmenterOption = DEFAULT_SEGMENTER,
    geodesic: GeodesicOption = DEFAULT_GEODESIC,
    settings: SetOption = [],  # noqa: B006 (typer makes a new list each time)
    prim: PrimOption = [],  # noqa: B006
    frames: FramesOption = None,
    clip: ClipOption = None,
    fps: FpsOption = None,
    variant: VariantOption = [],  # noqa: B006
    uncompress: Annotated[
        bool,
        typer.Option(
            "--uncompress",
            help="Write plain floats into a glTF file whose vertices are compressed, quantised or "
            "sparse.",
        ),
    ] = False,
    strength: Annotated[
        float | None,
        typer.Option(help="How far each chip is driven, in bins; the scheme's default."),
    ] = None,
    max_mrms: Annotated[
        float | None,
        typer.Option(
            "--max-mrms",
            help="Limit to the distortion of all layers (MRMS over the diagonal).",
        ),
    ] = None,
    recipient: Annotated[
        str | None, typer.Option(help="Recipient of this copy; keep the name.")
    ] = None,
    master: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Keep SOURCE as the blind layers left it: `verify --original --master` reads "
            "copies beside it.",
        ),
    ] = None,
    deliver: Annotated[
        bool, typer.Option("--deliver", help="Write one flattened file without any unmarked point.")
    ] = False,
    allow_unmarked: Annotated[
        list[str],
        typer.Option(
            "--allow-unmarked",
            metavar="PRIM",
            help="Deliver this mesh, and all below it, although it holds no mark; `all` for any.",
        ),
    ] = [],  # noqa: B006
    keep_metadata: Annotated[
        bool,
        typer.Option("--keep-metadata", help="Deliver comments, authors and file paths too."),
    ] = False,
    skel: Annotated[
        str,
        typer.Option(
            metavar="bake|rest",
            help="What becomes of rigged meshes: write posed points without a rig, or keep the rig "
            "and mark its rest pose.",
        ),
    ] = BAKE,
    stamp: Annotated[
        bool,
        typer.Option("--stamp", help="Say on the marked prims that they are (MeshmarkAPI)."),
    ] = False,
    primvars: Annotated[
        str,
        typer.Option(
            metavar="follow|keep",
            help="What becomes of texture coordinates, colours and normals where points slid: take "
            "their values from the new place, or keep them.",
        ),
    ] = FOLLOW,
    ledger: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="Record the copy in this ledger: a file, or postgresql://USER@HOST/NAME.",
        ),
    ] = None,
    asset: Annotated[
        str | None,
        typer.Option(help="What the ledger calls SOURCE; by default its name without suffix."),
    ] = None,
    asset_version: Annotated[
        str | None,
        typer.Option(
            "--asset-version",
            help="Which version of it; by default the first digits of its SHA-256.",
        ),
    ] = None,
    c2pa: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Sign a C2PA sidecar beside OUTPUT, by this chain of certificates (PEM).",
        ),
    ] = None,
    c2pa_key: Annotated[
        Path | None,
        typer.Option("--c2pa-key", metavar="FILE", help="Private key of its first (PEM)."),
    ] = None,
    c2pa_tsa: Annotated[
        str | None,
        typer.Option(
            "--c2pa-tsa", metavar="URL", help="Have the signature stamped by this authority."
        ),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write an HTML page, too: before and after, displacement, figures."
        ),
    ] = None,
    check_all: Annotated[
        bool,
        typer.Option(
            "--check-all", help="Compare and verify all frames of OUTPUT, not twelve of each mesh."
        ),
    ] = False,
    every: Annotated[
        bool,
        typer.Option("--all", help="Print every message, not only the first few of each kind."),
    ] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Do everything but write.")] = False,
    trusted: TrustedOption = False,
    json: JsonOption = False,
) -> None:
    """Mark SOURCE and write OUTPUT, with a manifest beside it, and verify what was written."""
    from meshmark.embedding.file import mark_file
    from meshmark.extension.recipe import layers_from_text
    from meshmark.workers.ordered_map import default_jobs

    layers = layers_from_text(
        scheme, segmenter, geodesic, settings, strength=strength, max_mrms=max_mrms
    )
    secret = load_key(key)
    parameters = reader_parameters(clip, fps, variant, uncompress=uncompress)
    _require_page(report, dry_run)
    signer = _signer(c2pa, c2pa_key, c2pa_tsa)
    recorder = _recorder(ledger, asset, asset_version, output, master)
    with frame_progress() as progress:
        manifest = mark_file(
            source,
            output,
            secret,
            recipe=layers,
            prims=prim,
            parameters=parameters,
            frames=frames,
            recipient=None if recipient is None else _name(recipient),
            master=master,
            deliver=deliver,
            allow_unmarked=allow_unmarked,
            keep_metadata=keep_metadata,
            skel=skel,
            stamp=stamp,
            primvars=primvars,
            check_all=check_all,
            dry_run=dry_run,
            record=recorder,
            signer=signer,
            trusted=trusted,
            jobs=default_jobs(),
            progress=progress,
        )
    document = manifest.document
    if json:
        put_json(document)
    tell_meshes(document, every)
    done = "is there already, made of the same; left as it is" if manifest.kept else "written"
    say("dry run: nothing was written" if dry_run else f"{document['output']}: {done}")
    if "c2pa" in document:
        say(f"{document['c2pa']['file']}: signed, record {document['record']}")
    if recorder is not None:
        recorder.tell()
    if report is not None:
        from meshmark.files.atomic import write_text
        from meshmark.reporting.report import mark_page

        instead = {"key": "KEYFILE", "c2pa_key": "KEYFILE"}
        if recorder is not None:
            # A URL may hold a password; the name does not.
            instead["ledger"] = recorder.ledger.name
        text = mark_page(
            document,
            source,
            output,
            recipes=layers,
            parameters=parameters,
            command=typed_command(context, instead),
            master=master,
            trusted=trusted,
        )
        write_text(text, report)
        say(f"{report}: written, {len(text.encode()) / 1e6:.2f} MB")
    tell_remarks(document, every)
    # What a deliverable may leave unmarked was agreed to before it was written.
    unmarked = document["verification"]["verdict"] == "not marked"
    if (document["skipped"] and not deliver) or unmarked:
        raise typer.Exit(NOT_ALL_MARKED)


def _require_page(report: Path | None, dry_run: bool) -> None:
    """Refuse a report that cannot be written, before any work is done."""
    from meshmark.errors import UsageError

    if report is None:
        return
    if dry_run:
        raise UsageError("--report tells of what was written; --dry-run writes nothing")
    from meshmark.reporting.report import require_page

    require_page(report)


def _recorder(
    ledger: str | None,
    asset: str | None,
    version: str | None,
    output: Path,
    master: Path | None,
) -> Recorder | None:
    """Open the ledger, if one is asked for: whoever cannot write to it need not start."""
    from meshmark.errors import UsageError

    if ledger is not None:
        return Recorder.of(ledger, asset, version, output, master)
    if asset is not None or version is not None:
        raise UsageError("--asset and --asset-version need --ledger")
    return None


def _signer(certificates: Path | None, key: Path | None, tsa: str | None) -> Signer | None:
    """Read who signs, if anybody does: whoever cannot sign need not start."""
    from meshmark.errors import UsageError

    if certificates is None and key is None and tsa is None:
        return None
    if certificates is None or key is None:
        raise UsageError("--c2pa and --c2pa-key go together; --c2pa-tsa needs both")
    from meshmark.c2pa.sidecar import require_installed

    require_installed()
    from meshmark.c2pa.signing import Signer

    return Signer.of(certificates, key, tsa)


def _name(text: str) -> str:
    from meshmark.errors import UsageError
    from meshmark.recipients import name_or_file

    named = name_or_file(text)
    if not isinstance(named, str):
        raise UsageError(f"--recipient {text}: a name that begins with @ is written @{text}")
    return named
