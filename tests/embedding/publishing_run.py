"""Marks a file in a process of its own that ends, or runs out of disk, wherever a test says.

    python publishing_run.py SOURCE OUTPUT RECIPIENT [KILL_AT]

KILL_AT counts the places where files are put in place or removed, one before and one after each.
"""

from __future__ import annotations

import os
import signal
import sys

from meshmark.embedding.file import mark_file
from meshmark.errors import MeshmarkError
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key

KEY = Key(bytes(range(32)))
CHANGES = ("replace", "rename", "unlink", "link")


def kill_at(place: int) -> None:
    """Have this process killed at a place, or say how many there were."""
    passed = 0

    def passing() -> None:
        nonlocal passed
        passed += 1
        if passed == place:
            os.kill(os.getpid(), signal.SIGKILL)

    for name in CHANGES:
        real = getattr(os, name)

        def changed(*args, real=real, **options):
            passing()
            try:
                return real(*args, **options)
            finally:
                passing()

        setattr(os, name, changed)


if __name__ == "__main__":
    source, output, recipient, *at = sys.argv[1:]
    kill_at(int(at[0]) if at else 0)
    try:
        mark_file(source, output, KEY, recipe=Recipe("cho2007"), recipient=recipient)
    except MeshmarkError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
