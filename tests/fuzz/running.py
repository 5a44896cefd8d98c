"""Runs the commands of an input in this process, and notes what came of each."""

from __future__ import annotations

import os
import resource
import shutil
import stat
import sys
import traceback
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from .inputs import Input
from .seeds import KEY

DATA_LIMIT = 3 << 30  # bytes; what is wrong is less
FILE_LIMIT = 1 << 28
OUTPUT_KEPT = 1 << 20
KEPT = "kept"
# The key's bytes, and so many of its digits anywhere in it.
DIGITS = 16
SECRETS = (KEY, *(KEY.hex()[i : i + DIGITS].encode() for i in range(2 * len(KEY) - DIGITS + 1)))


@dataclass(frozen=True)
class Ran:
    """What came of one command.

    Parameters
    ----------
    arguments : tuple of str
        The command.
    code : int
        Its exit code.
    out, err : str
        The beginning of what it printed.
    peak : int
        Most memory that was in use, in bytes.
    stray : tuple of str
        What was written where nothing should be, or was left over.
    tells_key : bool
        Whether the key is in what it printed or wrote.
    """

    arguments: tuple[str, ...]
    code: int
    out: str
    err: str
    peak: int
    stray: tuple[str, ...]
    tells_key: bool

    def as_json(self) -> dict[str, Any]:
        """Return it as JSON values."""
        return asdict(self)


def limit_resources() -> None:
    """Let this process, and those it starts, take little."""
    resource.setrlimit(resource.RLIMIT_DATA, (DATA_LIMIT, DATA_LIMIT))
    resource.setrlimit(resource.RLIMIT_FSIZE, (FILE_LIMIT, FILE_LIMIT))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


class Place:
    """Folders in which inputs are run: their own, one for temporary files, and one outside."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._outside = root / "outside"
        self._temporary = root / "tmp"
        self._streams = [root / "out.txt", root / "err.txt"]
        # Whoever was here before may have been killed.
        shutil.rmtree(root, ignore_errors=True)
        for folder in (self._outside, self._temporary):
            folder.mkdir(parents=True)
        (self._outside / KEPT).write_text(KEPT)

    def run(self, given: Input, arguments: tuple[str, ...], number: int) -> Ran:
        """Run one command of an input; the first one makes its folder."""
        folder = self._root / f"w{given.index}"
        if number == 0:
            _write(given, folder)
        before = _listing(folder)
        os.chdir(folder)
        os.environ["TMPDIR"] = str(self._temporary)
        _forget_peak()
        code = self._call(arguments)
        peak = _peak()
        out, err = (path.read_bytes()[:OUTPUT_KEPT] for path in self._streams)
        new = [path for path, what in _listing(folder).items() if before.get(path) != what]
        stray = [*self._strays(), *_unwanted(new, arguments)]
        written = [folder / name for name in new]
        seen = [out, err, *(path.read_bytes() for path in written if path.is_file())]
        tells = any(secret in text for text in seen for secret in SECRETS)
        told = (text.decode(errors="backslashreplace") for text in (out, err))
        return Ran(arguments, code, *told, peak, tuple(stray), tells)

    def clear(self, given: Input) -> None:
        """Remove the folder of an input."""
        os.chdir(self._root)
        shutil.rmtree(self._root / f"w{given.index}", ignore_errors=True)

    def _call(self, arguments: tuple[str, ...]) -> int:
        from meshmark.cli import main

        kept = [os.dup(1), os.dup(2)]
        for number, path in enumerate(self._streams, start=1):
            handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
            os.dup2(handle, number)
            os.close(handle)
        sys.argv = ["meshmark", *arguments]
        try:
            main()
            code = 0
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
        except BaseException:
            # MESHMARK_DEBUG lets it through.
            traceback.print_exc()
            code = 70
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            for number, handle in enumerate(kept, start=1):
                os.dup2(handle, number)
                os.close(handle)
        return code

    def _strays(self) -> list[str]:
        stray = [f"tmp/{path.name}" for path in self._temporary.iterdir()]
        known = {self._outside, self._temporary, *self._streams}
        stray += [
            path.name for path in self._root.iterdir() if path not in known and path.name[0] != "w"
        ]
        outside = [path.name for path in self._outside.iterdir()]
        if outside != [KEPT] or (self._outside / KEPT).read_text() != KEPT:
            stray.append("outside")
        return stray


def _write(given: Input, folder: Path) -> None:
    for name, content in given.files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    key = folder / "k"
    if not key.exists():
        key.write_text(f"meshmark-key-1\n{KEY.hex()}\n")
    key.chmod(0o600)


def _listing(folder: Path) -> dict[str, tuple[int, ...]]:
    listed = {}
    for path in folder.rglob("*"):
        status = path.lstat()
        if not stat.S_ISDIR(status.st_mode):
            listed[str(path.relative_to(folder))] = (
                status.st_size,
                status.st_mtime_ns,
                status.st_ino,
            )
    return listed


def _unwanted(new: list[str], arguments: tuple[str, ...]) -> list[str]:
    """Name what a command wrote beyond what was asked of it."""
    wanted = [
        after.partition(".")[0]
        for flag, after in pairwise(arguments)
        if flag in ("-o", "--evidence", "--store", "--report")
    ]
    return [name for name in new if not any(name.startswith(output) for output in wanted)]


def _forget_peak() -> None:
    Path("/proc/self/clear_refs").write_text("5")


def _peak() -> int:
    status = Path("/proc/self/status").read_text()
    own = int(status.split("VmHWM:")[1].split()[0]) << 10
    return max(own, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss << 10)
