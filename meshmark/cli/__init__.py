"""The command line: parse, call the core, print. One module a command."""

from __future__ import annotations

import atexit
import gc
import os
import sys

from meshmark.cli.ahead import reading_ahead
from meshmark.cli.stopping import Stopped, stopping
from meshmark.cli.streams import UNHEARD, Unheard, watched_streams
from meshmark.errors import DEBUG_VARIABLE, MeshmarkError, of_a_bug

BUG = 70

__all__ = ["main"]


def main() -> None:
    """Run the command line; every error is one line on stderr and an exit code."""
    # Whatever is measured keeps to one thread of linear algebra. To start more of them takes longer
    # than they are ever of use; here, before numpy is imported.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Or else, in the end, Python looks for garbage among all that was imported, again and again.
    atexit.register(gc.freeze)
    with watched_streams():
        _run()


def _run() -> None:
    try:
        with stopping(), reading_ahead(sys.argv[1:]):
            from meshmark.cli.app import app

            try:
                app(prog_name="meshmark")
            finally:
                # Buffered output can still fail.
                sys.stdout.flush()
    except MeshmarkError as error:
        _complain(str(error))
        sys.exit(error.exit_code)
    except Stopped as stop:
        _complain(str(stop))
        sys.exit(stop.exit_code)
    except Unheard:
        sys.exit(UNHEARD)
    except Exception as error:
        if os.environ.get(DEBUG_VARIABLE) == "1":
            raise
        _complain(of_a_bug(error))
        sys.exit(BUG)


def _complain(text: str) -> None:
    # Late: whoever reads ahead begins sooner then.
    from meshmark.cli.console import complain

    complain(text)
