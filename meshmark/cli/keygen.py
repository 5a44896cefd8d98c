"""`meshmark keygen`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from meshmark.cli.console import say


def keygen(
    keyfile: Annotated[Path, typer.Argument(help="The file to make.", show_default=False)],
) -> None:
    """Make a key file of 256 random bits, readable by its owner only."""
    from meshmark.keys import Key

    key = Key.generate()
    key.save(keyfile)
    say(f"{keyfile}: key {key.id}; keep it secret, and keep a copy: nothing can replace it")
