"""What pxr says about a stage, caught: its errors become ours, its warnings become notes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from pxr import Tf, UsdUtils

from meshmark.errors import InputError

# Composition messages end in where the stage lives in memory, which differs from run to run.
_NOISE = re.compile(r"\s*\((?:instantiating|recomposing|loading)[^()]*stage[^()]*\)\.?$")
_MANGLED = re.compile(r"pxrInternal_\w+?__::")
# The rule of the grammar that did not match, in the parser's own C++.
_RULE = re.compile(r"(?<=parse error) matching .*(?= at ')")
_UNOPENED = re.compile(r"(?:[Cc]ould not|[Uu]nable to|[Ff]ailed to) (?:open|load) [^@]*@([^@]*)@")
# Said after the error that has the reason.
_EMPTY_TALK = "Failed to open layer"
# What a value of a type of usd-core's own ends in, which damaged binary layers can hold.
_NO_SUCH_TYPE = "No to_python"


@contextmanager
def caught(
    source: str, *, prim: str | None = None, time: float | None = None
) -> Iterator[list[str]]:
    """Silence pxr, and turn what it raises into an `InputError` that says where.

    Parameters
    ----------
    source, prim, time
        What is being read, for the error.

    Yields
    ------
    list of str
        Filled, when the block ends, with what pxr would have printed: one line each, in
        order, without repeats.
    """
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    messages: list[str] = []
    try:
        yield messages
    except Tf.ErrorException as error:
        raise InputError(
            f"not readable as USD: {reason(error)}", source=source, prim=prim, time=time
        ) from None
    except UnicodeDecodeError as error:
        text = _one_line(_decoded(error))
        raise InputError(
            f"not readable as USD: text that is not UTF-8: {text[:40]!r}",
            source=source,
            prim=prim,
            time=time,
        ) from None
    except TypeError as error:
        if not str(error).startswith(_NO_SUCH_TYPE):
            raise
        raise InputError(
            "not readable as USD: a value is of a type that no attribute has",
            source=source,
            prim=prim,
            time=time,
        ) from None
    finally:
        said = (_commentary(item) for item in delegate.TakeUncoalescedDiagnostics())
        messages.extend(dict.fromkeys(said))


def reason(error: Tf.ErrorException) -> str:
    """Say in one line what a pxr error is about."""
    lines = [_commentary(item) for item in error.args]
    telling = [line for line in lines if not line.startswith(_EMPTY_TALK)]
    return next(iter([*telling, *lines]), "pxr gives no reason")


def unopened(messages: Iterable[str]) -> list[str]:
    """List the layers that pxr says it could not open, each once."""
    found = (_UNOPENED.search(message) for message in messages)
    return list(dict.fromkeys(match.group(1) for match in found if match))


def _commentary(diagnostic: Tf.DiagnosticBase) -> str:
    """Return what pxr says in one line; it may quote bytes of the file that are no text."""
    try:
        text = diagnostic.commentary
    except UnicodeDecodeError as error:
        text = _decoded(error)
    return _one_line(text)


def _decoded(error: UnicodeDecodeError) -> str:
    return bytes(error.object).decode("utf-8", "replace")


def _one_line(text: str) -> str:
    return _NOISE.sub("", _MANGLED.sub("", _RULE.sub("", " ".join(text.split()))))
