"""Names of those that copies are made for: one form to mark by, and every form to look for."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable
from io import StringIO
from pathlib import Path

from meshmark.errors import InputError, UsageError
from meshmark.files.reading import read_small

# Characters of a name, and bytes of a file of names.
LONGEST, MOST = 256, 1 << 26

_BYTE_ORDER_MARK = "\ufeff"
# Control characters, halves of pairs, line and paragraph separators.
_NO_TEXT = {"Cc", "Cs", "Zl", "Zp"}


def recipient_name(text: str) -> str:
    """Return the form of a name that copies are marked by.

    That is Unicode's normal form C, without blanks and byte order marks about it: what looks the
    same and was typed on another system is the same name.

    Raises
    ------
    UsageError
        If nothing is left, or it is too long or holds control characters.
    """
    name = unicodedata.normalize("NFC", text.strip().strip(_BYTE_ORDER_MARK).strip())
    if not name:
        raise UsageError("the name of a recipient is empty")
    if len(name) > LONGEST:
        raise UsageError(f"the name of a recipient has more than {LONGEST} characters")
    odd = next((c for c in name if unicodedata.category(c) in _NO_TEXT), None)
    if odd is not None:
        raise UsageError(f"the name of a recipient holds a control character, U+{ord(odd):04X}")
    return name


def spellings(names: Iterable[str]) -> tuple[str, ...]:
    """List what to look for where copies of these names may be, each once, in order.

    A name that is not in the form of `recipient_name` is looked for as it stands too: before
    there was that form, copies were marked by it.

    Raises
    ------
    UsageError
        If one is no name.
    """
    return tuple(dict.fromkeys(form for name in names for form in (recipient_name(name), name)))


def name_or_file(text: str) -> str | Path:
    """Tell a name on the command line from `@FILE`; `@@name` is the name `@name`."""
    if text.startswith("@@"):
        return text[1:]
    return Path(text[1:]) if text.startswith("@") else text


def read_names(path: Path) -> list[str]:
    r"""Read names from a UTF-8 file, with or without a byte order mark, one a line.

    Blank lines and lines that begin with `#` are no names; `\#name` is the name `#name`.

    Raises
    ------
    InputError
        If the file cannot be read, or a line is no name.
    """
    names = []
    for number, line in enumerate(StringIO(_text(path), newline=None), start=1):
        name = line.strip().strip(_BYTE_ORDER_MARK).strip()
        if not name or name.startswith("#"):
            continue
        if name.lstrip("\\").startswith("#"):
            name = name[1:]
        try:
            recipient_name(name)
        except UsageError as error:
            raise InputError(f"line {number}: {error.message}", source=path) from None
        names.append(name)
    return names


def _text(path: Path) -> str:
    try:
        return read_small(path, MOST).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError("names must be UTF-8 text", source=path) from None
