"""Has the file that `verify` is asked about read while all is imported that asks for it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from meshmark.sources.isolation.process import drop_ahead, read_ahead

# Options of `verify` with which a file is read as it is, those with a value apart.
SWITCHES = ("--all", "--json", "--jsonl")
VALUED = (
    "--fpr",
    "--frames",
    "--geodesic",
    "--jobs",
    "--key",
    "--master",
    "--original",
    "--recipient",
    "--scheme",
    "--segmenter",
    "--set",
)


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
    read_ahead(source)
    try:
        yield
    finally:
        drop_ahead()


def source_of(words: Sequence[str]) -> str | None:
    """Return the one file that is to be verified as it is; None if it takes more to know it."""
    if not words or words[0] != "verify":
        return None
    named, rest = [], iter(words[1:])
    for word in rest:
        option, equals, _ = word.partition("=")
        if option in VALUED:
            if not equals:
                next(rest, None)
        elif not word.startswith("-"):
            named.append(word)
        elif word not in SWITCHES:
            return None
    if len(named) != 1 or named[0].startswith("@") or not Path(named[0]).is_file():
        return None
    return named[0]
