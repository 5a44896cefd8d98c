"""The process that reads, run with `python -P -m`: FOLDER SOURCE TEXTURES PARAMETERS PRIM..."""

from __future__ import annotations

import errno
import json
import os
import signal
import sys
import traceback
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NoReturn

from meshmark.errors import InputError, MeshmarkError, OutputError
from meshmark.files.temporary import no_room
from meshmark.sources.digests import sha256, stamps_of
from meshmark.sources.facts import files_in_reach, source_files
from meshmark.sources.isolation.frames import ArrayWriter
from meshmark.sources.isolation.limits import DISK_VARIABLE, Limits
from meshmark.sources.isolation.process import ARRAYS, REPORT, WITH_TEXTURES
from meshmark.sources.isolation.report import describe_asset, describe_error
from meshmark.sources.readers import open_source


class Child:
    """The process that works on one source within limits, for the parent that started it.

    A byte on stdout says that it goes on; what it has to say is left in the folder.
    """

    def __init__(self, folder: Path, source: str) -> None:
        # Whoever is told to end is our parent, which ends us.
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            if hasattr(signal, name):
                signal.signal(getattr(signal, name), signal.SIG_IGN)
        self.folder, self.source = folder, source
        self.limits = Limits.from_environment()
        # What libraries print is no sign of progress.
        self._alive = os.dup(1)
        os.dup2(2, 1)

    def beat(self) -> None:
        """Say that it goes on."""
        self.limits.expect_progress()
        os.write(self._alive, b".")

    def files(self) -> list[Path]:
        """List the files the source consists of; absolute paths."""
        files = [path.resolve() for path in source_files(self.source)]
        self.beat()
        return files

    def digests(self, files: Iterable[Path]) -> list[tuple[str, str]]:
        """Hash files."""
        return [(str(path), sha256(path, beat=self.beat)) for path in files]

    def run(self, work: Callable[[], dict[str, Any]]) -> NoReturn:
        """Do the work, leave its report or why there is none, and end."""
        report = json.dumps(self._outcome(work), default=vars)
        (self.folder / REPORT).write_text(report, encoding="ascii")
        # Without taking down libraries that a hostile file has been through.
        os._exit(0)

    def _outcome(self, work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        self.beat()
        self.limits.impose(self.source)
        try:
            return work()
        except MeshmarkError as error:
            return {"error": describe_error(error)}
        except MemoryError:
            return {"memory": self.limits.memory}
        except Exception as error:
            # What the system's loader says of a library.
            if isinstance(error, ImportError) and "failed to map segment" in str(error):
                return {"memory": self.limits.memory}
            where = traceback.format_exc()
            return {"bug": f"{type(error).__name__}: {error}", "traceback": where}


def _read(
    child: Child, prims: list[str], parameters: dict[str, Any], textures: bool
) -> dict[str, Any]:
    files = child.files()
    stamps, before = stamps_of(files), child.digests(files)
    asset = open_source(child.source, prims, parameters)
    child.beat()
    try:
        with (child.folder / ARRAYS).open("wb") as file:
            arrays = ArrayWriter(file)
            told = describe_asset(asset, arrays, textures=textures, beat=child.beat)
    except OSError as error:
        raise _too_much(child, error) from None
    files = child.files()
    is_stamped = stamps is not None and stamps_of(files) == stamps
    if not is_stamped and child.digests(files) != before:
        raise InputError("changed while it was read; try again", source=child.source)
    reach = [str(path) for path in files_in_reach(child.source)]
    return {"asset": told, "files": before, "reach": reach}


def _too_much(child: Child, error: OSError) -> MeshmarkError:
    if error.errno == errno.EFBIG:
        return InputError(
            f"its frames fill more than {child.limits.disk:g} GB; {DISK_VARIABLE} can allow more",
            source=child.source,
        )
    return OutputError(no_room(error), source=child.source)


def main() -> None:
    """Read what the command line says."""
    folder, source, textures, parameters, *prims = sys.argv[1:]
    child = Child(Path(folder), source)
    child.run(lambda: _read(child, prims, json.loads(parameters), textures == WITH_TEXTURES))


if __name__ == "__main__":
    main()
