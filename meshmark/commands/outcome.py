"""What is asked of each of many sources, and what becomes of one: an answer, or a reason."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeAlias, TypeVar

from meshmark.errors import (
    DEBUG_VARIABLE,
    InputError,
    MeshmarkError,
    TimeLimitError,
    WorkerError,
    of_a_bug,
)
from meshmark.sources.digests import file_hashes, sha256
from meshmark.sources.readers import files_named

if TYPE_CHECKING:
    from meshmark.detection.verdict import Answer

# Paths, and their SHA-256.
Files: TypeAlias = Sequence[tuple[str, str]]


class AnyRequest(Protocol):
    """What is asked of every source. It can be pickled and sent anywhere, and holds no key."""

    @property
    def recorded(self) -> bool:
        """Whether outcomes tell the hashes of what was read, and what was asked."""

    @property
    def timeout(self) -> float | None:
        """Seconds that one source may take, if that is limited."""

    @property
    def paths(self) -> Sequence[str | Path | None]:
        """What else is read for every source, or written."""

    def asked(self, source: str) -> dict[str, Any]:
        """Tell all that the answer for a source depends on, beside its files."""


class AnyVerdict(Protocol):
    """What may be found: see `Verdict` and `Identification`."""

    @property
    def verdict(self) -> Answer:
        """The answer."""

    def as_json(self) -> dict[str, Any]:
        """Return it as it is printed."""


Found = TypeVar("Found", bound=AnyVerdict, covariant=True)


@dataclass(frozen=True, eq=False)
class Outcome(Generic[Found]):
    """What became of one source: a verdict, or the reason why there is none.

    Parameters
    ----------
    source : str
    verdict : Verdict or Identification, or None
    error : str
        In one line; empty if there is a verdict.
    exit_code : int
        Of the error; 0 if there is none.
    files : sequence of {"file", "sha256"}
        What was read, relative to the source's folder, if that is recorded.
    asked : mapping
        See `AnyRequest.asked`; likewise.
    timeout : float, optional
        Seconds that it took and more, if that is the reason.
    """

    source: str
    verdict: Found | None = None
    error: str = ""
    exit_code: int = 0
    files: Sequence[dict[str, str]] = ()
    asked: Mapping[str, Any] = field(default_factory=dict)
    timeout: float | None = None

    @property
    def answer(self) -> Answer | None:
        """What the verdict is, if there is one."""
        return None if self.verdict is None else self.verdict.verdict

    def as_json(self) -> dict[str, Any]:
        """Return its line in `--jsonl`."""
        recorded = {"files": list(self.files), "asked": dict(self.asked)}
        if self.verdict is not None:
            return {**self.verdict.as_json(), **recorded}
        return {
            "source": self.source,
            "error": self.error,
            "exit_code": self.exit_code,
            **({} if self.timeout is None else {"timeout": self.timeout}),
            **recorded,
        }


def outcome_of(
    source: str, request: AnyRequest, answer: Callable[[], tuple[Found, Files]]
) -> Outcome[Found]:
    """Answer for a source. Whatever is wrong with it is part of the outcome.

    Parameters
    ----------
    answer : callable
        Returns a verdict, and the files that it was read from if they are recorded.
    """
    asked = request.asked(source) if request.recorded else {}
    try:
        verdict, files = answer()
    except Exception as error:
        if not isinstance(error, MeshmarkError) and os.environ.get(DEBUG_VARIABLE) == "1":
            raise
        return Outcome(source, None, *_told(error, source), _readable(source, request), asked)
    return Outcome(source, verdict, "", 0, _relative(files, source), asked)


def failed(source: str, error: MeshmarkError, request: AnyRequest) -> Outcome[Any]:
    """Return the outcome where a source could not be worked on at all, or not to its end."""
    told = error.message if error.source is None else str(error)
    late = isinstance(error, TimeLimitError)
    return Outcome(
        source,
        None,
        f"{source}: {told}",
        error.exit_code,
        # What is tried again need not be known again.
        _readable(source, request) if late else (),
        request.asked(source) if request.recorded else {},
        request.timeout if late else None,
    )


def nobody(stage: str, what: str, done: int, total: int) -> None:
    """Tell nobody of progress."""


def folder_of(source: str) -> Path:
    """Return the folder that the files of a source are named relative to."""
    return Path(source).parent.resolve()


def _told(error: Exception, source: str) -> tuple[str, int]:
    """Say in one line what went wrong, and with which exit code."""
    if isinstance(error, MeshmarkError):
        return str(error), error.exit_code
    if isinstance(error, MemoryError):
        return f"{source}: needs more memory than there is", WorkerError.exit_code
    return f"{source}: {of_a_bug(error)}", MeshmarkError.exit_code


def _readable(source: str, request: AnyRequest) -> list[dict[str, str]]:
    """Hash what can be of a source that there is no verdict on."""
    return _relative(_hashed(source), source) if request.recorded else []


def _hashed(source: str) -> Iterator[tuple[str, str]]:
    for path in files_named(source):
        if path.is_file():
            with suppress(InputError):
                yield str(path.resolve()), sha256(path)


def _relative(files: Iterable[tuple[str, str]], source: str) -> list[dict[str, str]]:
    return file_hashes(files, folder_of(source))
