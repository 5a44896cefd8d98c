"""The command line: parse, call the core, print. One module a command."""

from __future__ import annotations

import atexit
import gc
import os
import sys

from meshmark.cli.console import complain
from meshmark.cli.stopping import Stopped, stopping
from meshmark.cli.streams import UNHEARD, Unheard, watched_streams
from meshmark.errors import DEBUG_VARIABLE, MeshmarkError, of_a_bug

BUG = 70

__all__ = ["main"]


def main() -> None:
    """Run the command line; every error is one line on stderr and an exit code."""
    # Or else, in the end, Python looks for garbage among all that was imported, again and again.
    atexit.register(gc.freeze)
    with watched_streams():
        _run()


def _run() -> None:
    try:
        with stopping():
            from meshmark.cli.app import app

            try:
                app(prog_name="meshmark")
            finally:
                # Buffered output can still fail.
                sys.stdout.flush()
    except MeshmarkError as error:
        complain(str(error))
        sys.exit(error.exit_code)
    except Stopped as stop:
        complain(str(stop))
        sys.exit(stop.exit_code)
    except Unheard:
        sys.exit(UNHEARD)
    except Exception as error:
        if os.environ.get(DEBUG_VARIABLE) == "1":
            raise
        complain(of_a_bug(error))
        sys.exit(BUG)
