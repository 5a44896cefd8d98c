"""The text of one OBJ file, taken apart and put together again by array operations.

Every step before parsing keeps the length of the text (comments, keywords and continuations
are blanked, not cut out), so that a number's place in the work copy is its place in the file.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import InputError
from meshmark.mesh.checks import measurable
from meshmark.mesh.precision import stored
from meshmark.mesh.topology import Topology

ByteArray = NDArray[np.uint8]

_SPACE, _NEWLINE, _HASH, _SLASH, _MINUS = b" \n#/-"
_BLANK = np.zeros(256, dtype=bool)
_BLANK[list(b" \t\r\n\v\f")] = True
_COORDINATE = re.compile(
    rb"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?|[+-]?(inf|infinity|nan)", re.IGNORECASE
)
# What follows the first slash, indices of texture and normal, is not looked at.
_CORNER = re.compile(rb"[+-]?\d+(/.*)?", re.DOTALL)


class ObjText:
    """The `v` and `f` lines of an OBJ file; all others are left alone.

    Parameters
    ----------
    data : bytes
        Content of the file.

    Raises
    ------
    InputError
        If it is not text, or, from the methods, if a line is wrong; the message gives its number.

    References
    ----------
    Wavefront Technologies, "Object Files (.obj)", Advanced Visualizer manual, appendix B.
    """

    def __init__(self, data: bytes) -> None:
        if b"\0" in data:
            raise InputError("this is not a text file")
        self.data = data
        text = _plain(data)
        ends = np.flatnonzero(text == _NEWLINE) + 1
        starts = np.concatenate([[0], ends[:-1]])
        self._text = text
        self._starts, self._ends = starts, ends
        first = _skip_indent(text, starts, ends)
        following = _BLANK[text[np.minimum(first + 1, len(text) - 1)]]
        self._is_vertex = (text[first] == ord("v")) & following
        self._is_face = (text[first] == ord("f")) & following
        # With the keywords gone, the lines hold nothing but numbers.
        text[first[self._is_vertex | self._is_face]] = _SPACE

    @property
    def n_points(self) -> int:
        """Number of `v` lines."""
        return int(self._is_vertex.sum())

    def points(self) -> FloatArray:
        """Parse the positions, (N, 3) float64; a fourth and later numbers are not looked at."""
        text, counts = self._vertex_numbers
        if not len(counts):
            raise InputError("there are no vertices (v lines)")
        if counts.min() < 3:
            line = self._line_number(self._is_vertex, int(np.argmin(counts)))
            raise InputError(f"line {line}: a vertex needs three coordinates")
        values = _numbers(text, np.float64)
        if values is None or len(values) != counts.sum():
            raise self._not_a_number(self._is_vertex, _COORDINATE, "coordinate")
        V = values[_first_three(counts)].reshape(-1, 3)
        fit = measurable(V)
        if not fit.all():
            line = self._line_number(self._is_vertex, int(np.argmin(fit)))
            raise InputError(
                f"line {line}: a coordinate is not finite, or too far from the origin to compute "
                "with"
            )
        return V

    def topology(self) -> Topology:
        """Parse the polygons; texture and normal indices are not looked at.

        Faces with an index out of range are left out while there are others.
        """
        text = self._lines_text(self._is_face)
        if not len(text):
            raise InputError("there are no faces (f lines)")
        counts = _count_numbers(text, self._lengths(self._is_face))
        if counts.min() < 3:
            line = self._line_number(self._is_face, int(np.argmin(counts)))
            raise InputError(f"line {line}: a face needs three corners")
        given = _numbers(_drop_slashes(text), np.int64)
        if given is None or len(given) != counts.sum():
            raise self._not_a_number(self._is_face, _CORNER, "face index")
        indices = self._resolve(given, counts)
        if indices.min() >= 0:
            return Topology(counts, indices, self.n_points)
        told = self._bad_corner(given, counts, int(np.argmin(indices)))
        try:
            topology = Topology.fit(counts, indices, self.n_points)
        except InputError:
            raise InputError(told) from None
        gone = len(counts) - len(topology.counts)
        return replace(topology, left_out=f"{gone} of {len(counts)} faces cannot be used: {told}")

    def fingerprint(self) -> bytes:
        """Digest the face lines and all that decides what they mean, without parsing them."""
        text = self._lines_text(self._is_face)
        digest = hashlib.blake2b(text.tobytes(), digest_size=16)
        digest.update(str(self.n_points).encode())
        if np.any(text == _MINUS):
            # A relative index means another vertex when vertices come earlier or later.
            digest.update(np.cumsum(self._is_vertex)[self._is_face].tobytes())
        return digest.digest()

    def with_points(self, V: FloatArray) -> bytes:
        """Return the file with other positions, in as many digits as float32 needs.

        A coordinate that equals what the file says keeps its text; so does everything else.

        Raises
        ------
        OutputError
            If a point is not finite, or beyond what float32 holds; the caller adds where.
        """
        changed = (self.points() != V).ravel()
        if not changed.any():
            return self.data
        starts, ends = (place[changed] for place in self._coordinate_places)
        words = stored(V, np.float32).ravel()[changed].astype("S")
        return _splice(np.frombuffer(self.data, dtype=np.uint8), starts, ends, words)

    @cached_property
    def _vertex_numbers(self) -> tuple[ByteArray, IntArray]:
        text = self._lines_text(self._is_vertex)
        return text, _count_numbers(text, self._lengths(self._is_vertex))

    @property
    def _coordinate_places(self) -> tuple[IntArray, IntArray]:
        text, counts = self._vertex_numbers
        where = np.flatnonzero(self._bytes_of(self._is_vertex))
        blank = np.concatenate([[True], _BLANK[text]])
        starts = np.flatnonzero(blank[:-1] & ~blank[1:])
        ends = np.flatnonzero(~blank[:-1] & blank[1:])
        three = _first_three(counts)
        # The byte after a number is in the same line, hence directly behind it in the file.
        return where[starts[three]], where[ends[three] - 1] + 1

    def _bytes_of(self, chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
        return np.repeat(chosen, self._ends - self._starts)

    def _lines_text(self, chosen: NDArray[np.bool_]) -> ByteArray:
        return self._text[self._bytes_of(chosen)]

    def _lengths(self, chosen: NDArray[np.bool_]) -> IntArray:
        lengths: IntArray = self._ends - self._starts
        return lengths[chosen]

    def _line_number(self, chosen: NDArray[np.bool_], row: int) -> int:
        # A continued line counts as the line it starts on: count the file's own line ends.
        start = int(self._starts[np.flatnonzero(chosen)[row]])
        return self.data[:start].count(b"\n") + 1

    def _not_a_number(
        self, chosen: NDArray[np.bool_], pattern: re.Pattern[bytes], what: str
    ) -> InputError:
        for row, index in enumerate(np.flatnonzero(chosen)):
            words = self._text[self._starts[index] : self._ends[index]].tobytes().split()
            for word in words:
                if pattern.fullmatch(word) is None:
                    shown = word[:40].decode("utf-8", "replace")
                    number = self._line_number(chosen, row)
                    return InputError(f"line {number}: {shown!r} is not a {what}")
        return InputError(f"a {what} is not a number")

    def _resolve(self, given: IntArray, counts: IntArray) -> IntArray:
        """Turn 1-based and relative (negative) indices into 0-based ones; -1 if out of range."""
        seen = np.cumsum(self._is_vertex)[self._is_face]
        indices = np.where(given > 0, given - 1, np.repeat(seen, counts) + given)
        bad = (given == 0) | (indices < 0) | (indices >= self.n_points)
        return np.where(bad, -1, indices)

    def _bad_corner(self, given: IntArray, counts: IntArray, corner: int) -> str:
        row = int(np.searchsorted(np.cumsum(counts), corner, side="right"))
        return (
            f"line {self._line_number(self._is_face, row)}: "
            f"face index {given[corner]} is out of range for {self.n_points} vertices"
        )


def _plain(data: bytes) -> ByteArray:
    """Blank byte order mark, comments and continuations in a copy that ends with a line end."""
    if data.startswith(b"\xef\xbb\xbf"):
        data = b"   " + data[3:]
    if b"\r" in data and b"\n" not in data:
        # Old Macintosh line ends.
        data = data.replace(b"\r", b"\n")
    text = np.frombuffer(data + b"\n", dtype=np.uint8).copy()
    # Comments first: one that ends in a backslash (a Windows path, say) continues nothing.
    _blank_comments(text)
    if b"\\" in data:
        joined = text.tobytes().replace(b"\\\r\n", b"   ").replace(b"\\\n", b"  ")
        text = np.frombuffer(joined[:-1] + b"\n", dtype=np.uint8).copy()
    return text


def _blank_comments(text: ByteArray) -> None:
    """Overwrite everything from the first # of a line to its end with spaces."""
    hashes = np.flatnonzero(text == _HASH)
    if not len(hashes):
        return
    ends = np.flatnonzero(text == _NEWLINE)
    lines, first = np.unique(np.searchsorted(ends, hashes), return_index=True)
    step = np.zeros(len(text) + 1, dtype=np.int8)
    step[hashes[first]] += 1
    step[ends[lines]] -= 1
    text[np.cumsum(step[:-1], dtype=np.int8) > 0] = _SPACE


def _skip_indent(text: ByteArray, starts: IntArray, ends: IntArray) -> IntArray:
    """Find the first byte of each line that is not blank, or its line end."""
    first = starts.copy()
    indented = np.flatnonzero(_BLANK[text[first]] & (first < ends - 1))
    while len(indented):
        first[indented] += 1
        still = _BLANK[text[first[indented]]] & (first[indented] < ends[indented] - 1)
        indented = indented[still]
    return first


def _count_numbers(text: ByteArray, lengths: IntArray) -> IntArray:
    """Count the words of each line, (lines,) int."""
    if not len(lengths):
        return np.zeros(0, dtype=np.int64)
    blank = np.concatenate([[True], _BLANK[text]])
    begins = (blank[:-1] & ~blank[1:]).astype(np.int64)
    return np.add.reduceat(begins, np.concatenate([[0], np.cumsum(lengths)[:-1]]))


def _numbers(text: ByteArray, kind: type[np.generic]) -> NDArray[Any] | None:
    """Parse numbers with blanks between them; None where a word is none."""
    try:
        return np.fromstring(text.tobytes(), dtype=kind, sep=" ")
    except ValueError:
        return None


def _first_three(counts: IntArray) -> IntArray:
    """List where the first three of each line's numbers are among all numbers, (3 lines,)."""
    begin = np.cumsum(counts) - counts
    return (begin[:, None] + np.arange(3)).ravel()


def _drop_slashes(text: ByteArray) -> ByteArray:
    """Blank what follows a slash within a word: 7/8/9 becomes 7."""
    if not np.any(text == _SLASH):
        return text
    place = np.arange(len(text))
    blank = np.maximum.accumulate(np.where(_BLANK[text], place, -1))
    slash = np.maximum.accumulate(np.where(text == _SLASH, place, -1))
    return np.where(slash > blank, np.uint8(_SPACE), text)


def _splice(text: ByteArray, starts: IntArray, ends: IntArray, words: NDArray[np.bytes_]) -> bytes:
    """Replace the stretches [start, end) of a text by words."""
    width = words.dtype.itemsize
    letters = words.view(np.uint8).reshape(len(words), width)
    used = letters != 0
    sizes = used.sum(axis=1)
    growth = np.cumsum(sizes - (ends - starts))
    step = np.zeros(len(text) + 1, dtype=np.int64)
    step[ends] = np.diff(growth, prepend=0)
    gone = np.zeros(len(text) + 1, dtype=np.int8)
    gone[starts] += 1
    gone[ends] -= 1
    kept = np.cumsum(gone[:-1]) == 0
    place = np.arange(len(text)) + np.cumsum(step[:-1])
    out = np.empty(len(text) + int(growth[-1]), dtype=np.uint8)
    out[place[kept]] = text[kept]
    begin = starts + growth - (sizes - (ends - starts))
    row, column = np.nonzero(used)
    out[begin[row] + column] = letters[used]
    return out.tobytes()
