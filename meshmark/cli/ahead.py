"""Has the file that a command is about read while all is imported that asks for it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from meshmark.sources.isolation.process import drop_ahead, read_ahead


@dataclass(frozen=True)
class Reading:
    """How a command reads the one file that it is about.

    Parameters
    ----------
    textures : bool
        Whether texture coordinates are read, too.
    switches, valued : tuple of str
        Options with which it is read as it is, those with a value apart.
    """

    textures: bool
    switches: tuple[str, ...]
    valued: tuple[str, ...]


READINGS = {
    "embed": Reading(
        True,
        (
            *("--all", "--check-all", "--deliver", "--dry-run", "--json", "--keep-metadata"),
            "--stamp",
        ),
        (
            *("--allow-unmarked", "--asset", "--asset-version", "--c2pa", "--c2pa-key"),
            *("--c2pa-tsa", "--frames", "--geodesic", "--key", "--ledger", "--master"),
            *("--max-mrms", "--output", "-o", "--primvars", "--recipient", "--report"),
            *("--scheme", "--segmenter", "--set", "--skel", "--strength"),
        ),
    ),
    "verify": Reading(
        False,
        ("--all", "--json", "--jsonl"),
        (
            *("--fpr", "--frames", "--geodesic", "--jobs", "--key", "--master", "--original"),
            *("--recipient", "--scheme", "--segmenter", "--set"),
        ),
    ),
}


@contextmanager
def reading_ahead(words: Sequence[str]) -> Iterator[None]:
    """Start reading what a command line is about, if that is plain; end it if nobody wanted it.

    Parameters
    ----------
    words : sequence of str
        The command and its arguments.
    """
    source = source_of(words)
    if source is None:
        yield
        return
    read_ahead(source, READINGS[words[0]].textures)
    try:
        yield
    finally:
        drop_ahead()


def source_of(words: Sequence[str]) -> str | None:
    """Return the one file that is to be read as it is; None if it takes more to know it."""
    reading = READINGS.get(words[0]) if words else None
    if reading is None:
        return None
    named, rest = [], iter(words[1:])
    for word in rest:
        option, equals, _ = word.partition("=")
        if option in reading.valued:
            if not equals:
                next(rest, None)
        elif not word.startswith("-"):
            named.append(word)
        elif word not in reading.switches:
            return None
    if len(named) != 1 or named[0].startswith("@") or not Path(named[0]).is_file():
        return None
    return named[0]
