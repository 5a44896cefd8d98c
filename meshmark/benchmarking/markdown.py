"""Pieces of Markdown that reports consist of."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Lay out a table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def number(x: float | None, form: str) -> str:
    """Format a number; a dash where there is none."""
    return "-" if x is None else format(x, form)
