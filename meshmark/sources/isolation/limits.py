"""What reading a source may take: time, memory, room on disk; and what measuring may."""

from __future__ import annotations

import math
import os
import sys
from dataclasses import dataclass
from pathlib import Path

from meshmark.errors import UsageError

SECONDS_VARIABLE = "MESHMARK_READ_SECONDS"
MEMORY_VARIABLE = "MESHMARK_READ_MEMORY"
DISK_VARIABLE = "MESHMARK_READ_DISK"
VERIFY_VARIABLE = "MESHMARK_VERIFY_MEMORY"
GB = 1e9  # bytes

# Of memory for measuring: libraries alone take half of one.
LEAST = 4.0  # GB

# Wall time the reading process is given beyond what its parent waits: it ends by itself only if
# there is no parent any more.
GRACE = 10  # seconds


@dataclass(frozen=True)
class Limits:
    """What reading a source may take.

    Parameters
    ----------
    seconds : float
        Until it is open, and for each further frame.
    memory : float
        GB beyond the size of the source.
    disk : float
        GB of temporary files.
    """

    seconds: float = 15.0
    memory: float = 2.0
    disk: float = 32.0

    @classmethod
    def from_environment(cls) -> Limits:
        """Return the limits that the environment sets, or the defaults.

        Raises
        ------
        UsageError
            If one is not a positive number.
        """
        return cls(
            _positive(SECONDS_VARIABLE, cls.seconds),
            _positive(MEMORY_VARIABLE, cls.memory),
            _positive(DISK_VARIABLE, cls.disk),
        )

    def impose(self, source: str) -> None:
        """Limit this process from now on, where the system knows how to."""
        if sys.platform == "win32":
            return
        import resource

        # What dumps a crash leaves would be as large as the memory.
        _limit(resource.RLIMIT_CORE, 0)
        _limit(resource.RLIMIT_FSIZE, int(self.disk * GB))
        path = Path(source)
        size = path.stat().st_size if path.is_file() else 0
        _limit(resource.RLIMIT_AS, _address_space() + int(self.memory * GB) + size)

    def expect_progress(self) -> None:
        """End this process unless this is called again in time, whatever it is at then.

        A signal does that even where a library never comes back; its parent gives up earlier.
        """
        if sys.platform != "win32":
            import signal

            signal.alarm(math.ceil(self.seconds) + GRACE)


def memory_to_measure() -> float:
    """Return the GB that a process may take that measures one source after the other.

    Raises
    ------
    UsageError
        If what the environment says is not a positive number.
    """
    return _positive(VERIFY_VARIABLE, _share_of_memory())


def limit_memory() -> None:
    """Limit this process to that from now on, where the system knows how to."""
    memory = memory_to_measure()
    if sys.platform != "win32" and memory < math.inf:
        import resource

        _limit(resource.RLIMIT_AS, int(memory * GB))


def _share_of_memory() -> float:
    """Return each processor's share of the memory there is, in GB, and at least `LEAST`."""
    try:
        total = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return math.inf
    return max(LEAST, total / GB / (os.cpu_count() or 1))


def _positive(variable: str, default: float) -> float:
    text = os.environ.get(variable)
    if text is None:
        return default
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise UsageError(f"{variable} must be a positive number, not {text!r}")
    return value


def _limit(kind: int, value: int) -> None:
    import resource

    _, most = resource.getrlimit(kind)
    allowed = value if most == resource.RLIM_INFINITY else min(value, most)
    try:
        resource.setrlimit(kind, (allowed, allowed))
    except (OSError, ValueError):
        # Such as macOS, which has no limit of this kind: the others hold all the same.
        return


def _address_space() -> int:
    """Return what of the address space this process has taken by now, in bytes, if known."""
    try:
        pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
    except OSError:
        return int(GB)
    return pages * os.sysconf("SC_PAGE_SIZE")
