"""The command line, run in this process."""

from __future__ import annotations

import os
import sys

import pytest

from meshmark.cli import main


def command(patch: pytest.MonkeyPatch, *arguments: object) -> int:
    """Run `meshmark` with some arguments; return the exit code. No workers, if nobody wants any."""
    patch.setattr(sys, "argv", ["meshmark", *map(str, arguments)])
    patch.setenv("MESHMARK_JOBS", os.environ.get("MESHMARK_JOBS", "1"))
    try:
        main()
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0
