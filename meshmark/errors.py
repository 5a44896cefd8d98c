"""Errors a user can act on: each names the file, prim and frame it is about."""

from __future__ import annotations

# Shows where a bug is, instead of one line about it.
DEBUG_VARIABLE = "MESHMARK_DEBUG"


class MeshmarkError(Exception):
    """Base of every error meshmark raises on purpose.

    Parameters
    ----------
    message
        What is wrong and what to do about it, in one line.
    source
        File or folder the error is about.
    prim
        Prim path inside the source.
    time
        Time code of the frame, where one frame is to blame.
    """

    exit_code = 70

    def __init__(
        self,
        message: str,
        *,
        source: object | None = None,
        prim: str | None = None,
        time: float | None = None,
    ) -> None:
        super().__init__(message)
        self.message = message
        self.source = None if source is None else str(source)
        self.prim = prim
        self.time = time

    def __str__(self) -> str:
        return f"{self.source}: {self.without_source()}" if self.source else self.without_source()

    def without_source(self) -> str:
        """Say what is wrong where, where it is clear which file is meant."""
        where = [self.prim] if self.prim else []
        if self.time is not None and self.time == self.time:
            where.append(f"frame {self.time:g}")
        return ": ".join([*where, self.message])

    def __reduce__(self) -> tuple[object, ...]:
        # Worker processes send errors home; keyword-only arguments need help to pickle.
        return (_rebuild, (type(self), self.message, self.source, self.prim, self.time))


def _rebuild(
    kind: type[MeshmarkError],
    message: str,
    source: str | None,
    prim: str | None,
    time: float | None,
) -> MeshmarkError:
    return kind(message, source=source, prim=prim, time=time)


class UsageError(MeshmarkError):
    """The request itself makes no sense: a bad flag, name, range or parameter value."""

    exit_code = 2


class InputError(MeshmarkError):
    """A source or key file that cannot be read or is not supported."""

    exit_code = 3


class NoExtentError(InputError):
    """A frame in which a mesh is scaled to nothing: it holds no mark, but is no fault either."""


class TimeLimitError(InputError):
    """A source that takes longer than it may."""


class OutputError(MeshmarkError):
    """A place that cannot be written to."""

    exit_code = 3


class CapacityError(MeshmarkError):
    """A mesh too small or too featureless to hold a mark."""

    exit_code = 3


class NoLayoutError(CapacityError):
    """A frame without the carriers that vertex trajectories would take to all other frames."""


class AlignmentError(MeshmarkError):
    """A copy that lies nowhere on its supposed original, or in several places equally well."""

    exit_code = 4


class PluginError(MeshmarkError):
    """A plugin that could not be loaded, or broke its contract."""

    exit_code = 5


class WorkerError(MeshmarkError):
    """A worker process that was ended from outside, or by a crash in native code."""

    exit_code = 5


def of_a_bug(error: Exception) -> str:
    """Say of an error that nobody has thought of what it is, in one line."""
    return (
        f"this is a bug in meshmark: {type(error).__name__}: {error}; "
        f"{DEBUG_VARIABLE}=1 shows where"
    )
