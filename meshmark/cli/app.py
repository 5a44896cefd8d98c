"""The commands, gathered. Each imports what it needs when it runs, so that --help is quick."""

from __future__ import annotations

from typing import Annotated

import typer

from meshmark.cli.align import align
from meshmark.cli.attack import attack
from meshmark.cli.bench import bench
from meshmark.cli.c2pa import c2pa
from meshmark.cli.check import check
from meshmark.cli.demo import demo
from meshmark.cli.embed import embed
from meshmark.cli.identify import identify
from meshmark.cli.inspect import inspect
from meshmark.cli.keygen import keygen
from meshmark.cli.ledger import ledger
from meshmark.cli.plugins import plugins
from meshmark.cli.report import report
from meshmark.cli.segment import segment
from meshmark.cli.try_keys import try_keys
from meshmark.cli.verify import verify

app = typer.Typer(
    help="Mark animated meshes, and find the mark again in a leaked copy.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    rich_markup_mode=None,
)


def _show_version(wanted: bool) -> None:
    if wanted:
        from meshmark.version import __version__

        typer.echo(__version__)
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show it.")
    ] = False,
) -> None:
    """Mark animated meshes, and find the mark again in a leaked copy."""


for command in (
    keygen,
    inspect,
    embed,
    verify,
    identify,
    report,
    align,
    check,
    attack,
    bench,
    segment,
    demo,
):
    app.command()(command)
app.command("try")(try_keys)
app.add_typer(c2pa, name="c2pa")
app.add_typer(ledger, name="ledger")
app.add_typer(plugins, name="plugins")
