"""The process that reads, run with `python -P -m`: FOLDER SOURCE TEXTURES PRIM...

A byte on stdout says that it goes on; what it has read is left in the folder.
"""

from __future__ import annotations

import errno
import json
import os
import signal
import sys
import traceback
from pathlib import Path
from typing import Any

from meshmark.errors import InputError, MeshmarkError, OutputError
from meshmark.files.temporary import no_room
from meshmark.sources.digests import sha256
from meshmark.sources.facts import files_in_reach, source_files
from meshmark.sources.isolation.frames import ArrayWriter
from meshmark.sources.isolation.limits import DISK_VARIABLE, Limits
from meshmark.sources.isolation.report import (
    ARRAYS,
    REPORT,
    WITH_TEXTURES,
    describe_asset,
    describe_error,
)
from meshmark.sources.readers import open_source


class Reading:
    """Reading one source into a folder, within limits."""

    def __init__(self, folder: Path, source: str, prims: list[str], textures: bool) -> None:
        self._folder, self._source, self._prims = folder, source, prims
        self._textures = textures
        self._limits = Limits.from_environment()
        # What libraries print is no sign of progress.
        self._alive = os.dup(1)
        os.dup2(2, 1)

    def run(self) -> dict[str, Any]:
        """Read, and return the report."""
        self.beat()
        self._limits.impose(self._source)
        try:
            return self._read()
        except MeshmarkError as error:
            return {"error": describe_error(error)}
        except MemoryError:
            return {"memory": self._limits.memory}
        except Exception as error:
            where = traceback.format_exc()
            return {"bug": f"{type(error).__name__}: {error}", "traceback": where}

    def beat(self) -> None:
        """Say that it goes on."""
        self._limits.expect_progress()
        os.write(self._alive, b".")

    def _read(self) -> dict[str, Any]:
        before = self._digests()
        asset = open_source(self._source, self._prims)
        self.beat()
        try:
            with (self._folder / ARRAYS).open("wb") as file:
                arrays = ArrayWriter(file)
                told = describe_asset(asset, arrays, textures=self._textures, beat=self.beat)
        except OSError as error:
            raise self._too_much(error) from None
        if self._digests() != before:
            raise InputError("changed while it was read; try again", source=self._source)
        reach = [str(path) for path in files_in_reach(self._source)]
        return {"asset": told, "files": before, "reach": reach}

    def _digests(self) -> list[tuple[str, str]]:
        files = [path.resolve() for path in source_files(self._source)]
        self.beat()
        return [(str(path), sha256(path, beat=self.beat)) for path in files]

    def _too_much(self, error: OSError) -> MeshmarkError:
        if error.errno == errno.EFBIG:
            return InputError(
                f"its frames fill more than {self._limits.disk:g} GB; {DISK_VARIABLE} can allow "
                "more",
                source=self._source,
            )
        return OutputError(no_room(error), source=self._source)


def main() -> None:
    """Read what the command line says."""
    # Whoever is told to end is our parent, which ends us.
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    folder, source, textures, *prims = sys.argv[1:]
    report = Reading(Path(folder), source, prims, textures == WITH_TEXTURES).run()
    (Path(folder) / REPORT).write_text(json.dumps(report, default=vars), encoding="ascii")
    # Without taking down libraries that a hostile file has been through.
    os._exit(0)


if __name__ == "__main__":
    main()
