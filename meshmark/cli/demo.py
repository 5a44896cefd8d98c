"""`meshmark demo`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from meshmark.cli.console import frame_progress


def demo(
    folder: Annotated[Path, typer.Argument(help="Where its files go; made if missing.")] = Path(
        "meshmark-demo"
    ),
) -> None:
    """Make an animated creature, mark, attack and verify it, and explain each step."""
    from meshmark.demo.story import tell
    from meshmark.workers.ordered_map import default_jobs

    with frame_progress() as progress:
        for line in tell(folder, jobs=default_jobs(), progress=progress):
            typer.echo(line)
