"""`meshmark check`."""

from __future__ import annotations

from typing import Annotated

import typer

from meshmark.cli.console import put_json
from meshmark.cli.options import JsonOption, TrustedOption

FOUND = 1


def check(
    file: Annotated[str, typer.Argument(help="A USD file.", show_default=False)],
    trusted: TrustedOption = False,
    json: JsonOption = False,
) -> None:
    """List what FILE gives away to its recipient; exit code 1 if it gives away anything."""
    from meshmark.commands.check import check_file

    document = check_file(file, trusted=trusted)
    if json:
        put_json(document)
    else:
        for each in document["findings"]:
            typer.echo(f"{each['kind']}: {each['where']}: {each['what']}")
        n = len(document["findings"])
        typer.echo(f"{file}: {f'{n} finding(s)' if n else 'nothing found'}")
    if document["findings"]:
        raise typer.Exit(FOUND)
