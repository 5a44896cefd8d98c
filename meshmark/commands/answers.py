"""The file of answers that `--resume` goes on with: one line of JSON for each source."""

from __future__ import annotations

import json
import os
import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from typing import Any

from meshmark.commands.outcome import AnyRequest, Outcome, folder_of
from meshmark.errors import InputError, MeshmarkError, OutputError, PluginError
from meshmark.files.atomic import written_beside
from meshmark.files.locks import held
from meshmark.files.reading import opened
from meshmark.sources.digests import sha256
from meshmark.sources.facts import source_files
from meshmark.sources.readers import files_named

# What is not the source's fault may not happen again.
TRIED_AGAIN = {PluginError.exit_code, MeshmarkError.exit_code}
# What every line begins with, and so what is left of one that was cut short.
BEGINNING = b'{"source": "'


@dataclass(frozen=True)
class Answer:
    """What a line says of a source.

    Parameters
    ----------
    source : str
    verdict : str or None
        None where there is an error.
    exit_code : int
        Of the error; 0 if there is none.
    files : sequence of {"file", "sha256"}
        What was read, relative to the source's folder.
    asked : str
        See `AnyRequest.asked`; as JSON.
    timeout : float or None
        Seconds that were too few for it, if that is the error.
    """

    source: str
    verdict: str | None
    exit_code: int
    files: Sequence[Mapping[str, str]]
    asked: str
    timeout: float | None = None

    def stands(self, timeout: float | None) -> bool:
        """Tell whether it would be the same again, with so much time."""
        return self.timeout is None or (timeout is not None and timeout <= self.timeout)


def answer_of(line: Mapping[str, Any]) -> Answer:
    """Make sense of a line.

    Raises
    ------
    KeyError, TypeError
        If it is none of ours.
    """
    answer = Answer(
        line["source"],
        line.get("verdict"),
        0 if "verdict" in line else line["exit_code"],
        line["files"],
        # One and the same for most.
        sys.intern(_canonical(line["asked"])),
        None if line.get("timeout") is None else float(line["timeout"]),
    )
    told = [(each["file"], each["sha256"]) for each in answer.files]
    texts = (answer.source, *(text for pair in told for text in pair))
    if not all(isinstance(text, str) for text in texts) or not isinstance(answer.exit_code, int):
        raise TypeError
    return answer


def _canonical(asked: Mapping[str, Any]) -> str:
    return json.dumps(asked, sort_keys=True)


def as_line(outcome: Outcome[Any]) -> str:
    """Return the line of an outcome, without its end."""
    return json.dumps(outcome.as_json(), allow_nan=False)


class AnswerFile:
    """A file of answers that nobody else adds to meanwhile; see `answers_kept`.

    Parameters
    ----------
    path : Path
    answers : sequence of Answer
        What is in it.
    file : FileIO
        Open to append to.
    """

    def __init__(self, path: Path, answers: Sequence[Answer], file: FileIO) -> None:
        self._path, self._file = path, file
        self._by_source: dict[str, list[Answer]] = defaultdict(list)
        self._by_name: dict[str, list[Answer]] = defaultdict(list)
        for answer in answers:
            self._by_source[answer.source].append(answer)
            self._by_name[Path(answer.source).name].append(answer)

    def known(self, sources: Sequence[str], request: AnyRequest) -> dict[str, Answer]:
        """Find the sources that are answered: of the same content, and asked the same.

        What took too long counts unless it may take longer now.

        An answer for another source of that name counts where that one is not asked for: folders
        are moved. None counts for two.
        """
        found: dict[str, Answer] = {}
        if not self._by_source:
            return found
        asked_for, taken = set(sources), set[int]()
        for source in sources:
            asked = _canonical(request.asked(source))
            content = _Content(source)
            moved = self._by_name[Path(source).name]
            others = [answer for answer in moved if answer.source not in asked_for]
            for answer in (*reversed(self._by_source[source]), *others):
                if id(answer) in taken or answer.asked != asked:
                    continue
                if not answer.stands(request.timeout) or not content.is_of(answer):
                    continue
                found[source] = answer
                taken.add(id(answer))
                break
        return found

    def append(self, line: str) -> None:
        """Write a line, the whole of it or nothing.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        end = self._path.stat().st_size
        left = line.encode("ascii") + b"\n"
        try:
            while left:
                left = left[self._file.write(left) :]
        except OSError as error:
            os.truncate(self._path, end)
            raise OutputError(f"cannot be written: {error.strerror}", source=self._path) from None


class _Content:
    """What is in a source now, each file hashed once."""

    def __init__(self, source: str) -> None:
        self._source = source
        self._folder = folder_of(source)
        self._known: dict[str, str | None] = {}

    def is_of(self, answer: Answer) -> bool:
        """Tell whether it is what an answer was given for."""
        if any(self._hash(each["file"]) != each["sha256"] for each in answer.files):
            return False
        # There may be more than there was: other frames, or a file that was missing.
        if answer.files and Path(self._source).is_file():
            return True
        named = files_named(self._source) if answer.exit_code else source_files(self._source)
        there = {file.resolve() for file in named if file.is_file()}
        return there == {(self._folder / each["file"]).resolve() for each in answer.files}

    def _hash(self, file: str) -> str | None:
        if file not in self._known:
            path = self._folder / file
            try:
                self._known[file] = sha256(path)
            except InputError:
                self._known[file] = None
        return self._known[file]


@contextmanager
def answers_kept(path: Path) -> Iterator[AnswerFile]:
    """Open a file of answers to go on with it; make it if it is missing.

    A last line that was cut short is removed, and so are errors that were not the source's fault.

    Raises
    ------
    InputError
        If it is no file of answers.
    OutputError
        If it cannot be written to, or somebody else does.
    """
    if path.is_dir():
        raise OutputError("is a folder", source=path)
    with held(path):
        answers = _repaired(path) if path.exists() or path.is_symlink() else []
        try:
            file = path.open("ab", buffering=0)
        except OSError as error:
            raise OutputError(f"cannot be written: {error.strerror}", source=path) from None
        with file:
            yield AnswerFile(path, answers, file)


def _repaired(path: Path) -> list[Answer]:
    """Read what is in a file, and leave what can stay in it."""
    answers: list[Answer] = []
    size = 0
    again = 0
    with opened(path) as file:
        for number, line in enumerate(file, start=1):
            if not line.endswith(b"\n"):
                _require_begun(line, number, path)
                break
            answers.append(_parsed(line, number, path))
            again += answers[-1].exit_code in TRIED_AGAIN
            size += len(line)
    if again:
        _rewrite(path, size)
    elif size < path.stat().st_size:
        os.truncate(path, size)
    return [answer for answer in answers if answer.exit_code not in TRIED_AGAIN]


def _rewrite(path: Path, size: int) -> None:
    """Leave out the lines of what is tried again."""
    with opened(path) as file, written_beside(path) as kept:
        while file.tell() < size:
            line = file.readline()
            if answer_of(json.loads(line)).exit_code not in TRIED_AGAIN:
                kept.write(line)


def _parsed(line: bytes, number: int, path: Path) -> Answer:
    try:
        return answer_of(json.loads(line))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise _refusal(number, path) from None


def _require_begun(line: bytes, number: int, path: Path) -> None:
    """Refuse a last line that cannot be one of ours, cut short."""
    if not line.startswith(BEGINNING) and not BEGINNING.startswith(line):
        raise _refusal(number, path)


def _refusal(number: int, path: Path) -> InputError:
    return InputError(
        f"line {number} is no answer of verify or identify; name another file", source=path
    )
