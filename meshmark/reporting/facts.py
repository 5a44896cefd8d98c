"""What a page says, before it is laid out: words, figures, tables, charts. No markup."""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib.metadata import version
from platform import python_version

from meshmark.version import __version__

# Libraries whose versions results may depend on.
LIBRARIES = ("numpy", "scipy", "usd-core")
# Rows of a table, and lines of a list, that a page prints.
MOST_ROWS = 300
# Of what a file says of itself, such as its path, so many characters are printed.
LONGEST = 160


@dataclass(frozen=True)
class Table:
    """A table; its first column names the rows.

    Parameters
    ----------
    caption : str
    columns : tuple of str
    rows : tuple of tuple of str
    numbers : tuple of int
        Columns that hold numbers.
    folded : bool
        Whether it is shown on demand only.
    """

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numbers: tuple[int, ...] = ()
    folded: bool = False

    def without_empty(self) -> Table:
        """Leave out the columns in which nothing stands."""
        kept = [i for i in range(len(self.columns)) if any(row[i] for row in self.rows)]
        return replace(
            self,
            columns=tuple(self.columns[i] for i in kept),
            rows=tuple(tuple(row[i] for i in kept) for row in self.rows),
            numbers=tuple(n for n, i in enumerate(kept) if i in self.numbers),
        )

    @property
    def printed(self) -> tuple[tuple[str, ...], ...]:
        """The first `MOST_ROWS` rows, no cell longer than `LONGEST`."""
        return tuple(tuple(map(shortened, row)) for row in self.rows[:MOST_ROWS])

    @property
    def more(self) -> int:
        """Rows that are not printed."""
        return max(0, len(self.rows) - MOST_ROWS)


@dataclass(frozen=True)
class Series:
    """The evidence of a mesh, frame by frame.

    Parameters
    ----------
    name : str
        The mesh, and by which scheme.
    times : tuple of str
        Time codes.
    log10_p : tuple of float
        Bounds, each from one frame alone.
    """

    name: str
    times: tuple[str, ...]
    log10_p: tuple[float, ...]


@dataclass(frozen=True)
class Section:
    """A part of the page under a heading."""

    heading: str
    paragraphs: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    series: tuple[Series, ...] = ()
    limit: float | None = None

    @property
    def printed_notes(self) -> tuple[str, ...]:
        """The first notes, and how many more there are."""
        told = tuple(map(shortened, self.notes[:MOST_ROWS]))
        more = len(self.notes) - len(told)
        return (*told, f"and {more} more") if more else told


@dataclass(frozen=True)
class Facts:
    """Everything a page says.

    Parameters
    ----------
    title : str
    kind : str
        What sort of page it is.
    answer : str
        "marked", "not marked" or "inconclusive".
    headline : str
        The answer in one sentence.
    words : tuple of str
        What it means, in plain words.
    figures : tuple of (str, str)
        The most important numbers.
    sections : tuple of Section
        What comes after the view.
    files : tuple of (str, str)
        Name and SHA-256 of every file involved.
    command : str
        What repeats it.
    command_note : str
        What has to be filled in.
    schemes : tuple of (str, str)
        Name and version of each scheme.
    """

    title: str
    kind: str
    answer: str
    headline: str
    words: tuple[str, ...]
    figures: tuple[tuple[str, str], ...]
    sections: tuple[Section, ...]
    files: tuple[tuple[str, str], ...]
    command: str
    command_note: str
    schemes: tuple[tuple[str, str], ...]

    @property
    def versions(self) -> tuple[tuple[str, str], ...]:
        """Versions of everything that results may depend on."""
        libraries = ((name, version(name)) for name in LIBRARIES)
        schemes = ((f"scheme {name}", number) for name, number in self.schemes)
        return (("meshmark", __version__), *schemes, ("Python", python_version()), *libraries)


def shortened(text: str) -> str:
    """Leave out the middle of what is too long."""
    half = (LONGEST - 5) // 2
    return text if len(text) <= LONGEST else f"{text[:half]} ... {text[-half:]}"
