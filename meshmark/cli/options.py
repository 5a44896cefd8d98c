"""Options that several commands share."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshmark.cli.console import warn

if TYPE_CHECKING:
    from meshmark.keys import Key

SourceArgument = Annotated[
    str,
    typer.Argument(
        help="A USD file, a folder or glob of OBJ frames, a glTF file.", show_default=False
    ),
]
OutputOption = Annotated[Path, typer.Option("--output", "-o", help="Where to write.")]
KeyOption = Annotated[Path, typer.Option("--key", help="Key file, from `meshmark keygen`.")]
SegmenterOption = Annotated[str, typer.Option(help="Segmenter, for schemes that need parts.")]
GeodesicOption = Annotated[
    str, typer.Option(help="Geodesic solver, for schemes that need distances.")
]
SetOption = Annotated[
    list[str],
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="A parameter of the scheme (bits=16), or of a plugin by name (sdf.rays=25).",
    ),
]
PrimOption = Annotated[list[str], typer.Option("--prim", help="Path of a mesh; all by default.")]
FramesOption = Annotated[
    str | None,
    typer.Option(metavar="A:B[:S]", help="Time codes from A to B, every S-th frame."),
]
ClipOption = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="Animation clip of a glTF file; the first by default."),
]
FpsOption = Annotated[
    float | None,
    typer.Option(help="Frames per second of a glTF file; by default those of its keys."),
]
VariantOption = Annotated[
    list[str],
    typer.Option(
        "--variant",
        metavar="SET=NAME|PRIM{SET=NAME}",
        help="Variant of a USD file to select, of all prims that have it or of one; by default, "
        "what the file selects.",
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON on stdout.")]
TrustedOption = Annotated[
    bool,
    typer.Option(
        "--trusted", help="Read SOURCE in this process: faster, but a bad file could crash it."
    ),
]
SeedOption = Annotated[int, typer.Option(help="Seed of the random numbers.")]


def reader_parameters(
    clip: str | None = None,
    fps: float | None = None,
    variants: Sequence[str] = (),
    *,
    uncompress: bool = False,
) -> dict[str, Any]:
    """Return the parameters of a reader that options give it."""
    from meshmark.errors import UsageError

    if fps is not None and not fps > 0:
        raise UsageError(f"--fps must be positive, not {fps:g}")
    given = {
        "clip": clip,
        "fps": fps,
        "variants": list(variants) or None,
        "uncompress": uncompress or None,
    }
    return {name: value for name, value in given.items() if value is not None}


def require_taken(parameters: dict[str, Any], sources: Sequence[str]) -> None:
    """Refuse parameters that the reader of no source takes."""
    from meshmark.errors import UsageError
    from meshmark.sources.readers import takes

    for name, value in parameters.items():
        if not any(takes(source, {name: value}) for source in sources):
            kind = "--variant is for USD" if name == "variants" else "--clip and --fps are for glTF"
            raise UsageError(f"{kind} files")


def load_key(path: Path) -> Key:
    """Read the key file, and warn if others can read it too."""
    from meshmark.keys import Key, readable_by_others

    key = Key.load(path)
    if readable_by_others(path):
        warn(f"{path}: this key file can be read by others; chmod 600 it")
    return key


def read_recipients(recipients: Sequence[str]) -> list[str]:
    """List the names that options give, those in files included, in every form to look for."""
    from meshmark.recipients import name_or_file, read_names, spellings

    names: list[str] = []
    for text in recipients:
        named = name_or_file(text)
        names += [named] if isinstance(named, str) else read_names(named)
    return list(spellings(names))
