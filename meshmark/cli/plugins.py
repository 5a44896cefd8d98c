"""`meshmark plugins`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from meshmark.cli.console import put_json, say, warn
from meshmark.cli.options import JsonOption

PLUGIN_FAILED = 5

plugins = typer.Typer(help="List, check and start plugins.", no_args_is_help=True)


@plugins.command("list")
def list_plugins(json: JsonOption = False) -> None:
    """List readers, segmenters, solvers, schemes and attacks, and what could not be loaded."""
    from meshmark.extension.registry import catalogue

    found = catalogue()
    if json:
        put_json(
            {
                "plugins": [
                    {
                        "kind": offer.kind,
                        "name": offer.name,
                        "summary": offer.record.summary,
                        "version": offer.record.version,
                        "distribution": offer.distribution,
                        "distribution_version": offer.distribution_version,
                        "parameters": dict(offer.record.parameters),
                    }
                    for offer in found.offers
                ],
                "broken": [vars(item) for item in found.broken],
                "collisions": [
                    {"kind": kind, "name": name, "distributions": list(claimed)}
                    for (kind, name), claimed in found.collisions.items()
                ],
            }
        )
        return
    width = max((len(offer.name) for offer in found.offers), default=0)
    for offer in found.offers:
        typer.echo(
            f"{offer.kind:<10} {offer.name:<{width}}  {offer.record.summary} ({offer.distribution})"
        )
    for item in found.broken:
        warn(f"plugin {item.plugin!r} of {item.distribution} is not loaded: {item.reason}")
    for (kind, name), claimed in found.collisions.items():
        warn(f"{kind} {name!r} cannot be used: offered by {' and by '.join(claimed)}")


@plugins.command("check")
def check_plugin(
    name: Annotated[str, typer.Argument(help="A name from `plugins list`.", show_default=False)],
) -> None:
    """Build the plugin NAME, try it on a small mesh, and report what is wrong with it."""
    from meshmark.errors import UsageError
    from meshmark.extension.registry import catalogue
    from meshmark.testing.smoke_check import check_plugin

    found = catalogue()
    broken = [item for item in found.broken if name in (item.plugin, item.distribution)]
    claimed = [key for key in found.collisions if key[1] == name]
    offers = [offer for offer in found.offers if offer.name == name]
    if not (broken or claimed or offers):
        known = ", ".join(offer.name for offer in found.offers)
        raise UsageError(f"no plugin is called {name!r}; known are: {known}")
    problems = [f"not loaded: {item.reason}" for item in broken]
    problems += [
        f"{kind} {name!r} is offered by {' and by '.join(found.collisions[kind, name])}"
        for kind, _ in claimed
    ]
    for offer in offers:
        problems += check_plugin(offer)
    for problem in problems:
        warn(f"{name}: {problem}")
    if problems:
        raise typer.Exit(PLUGIN_FAILED)
    for offer in offers:
        say(f"{offer.kind} {name} {offer.record.version} of {offer.distribution}: works")


@plugins.command("new")
def start_plugin(
    name: Annotated[str, typer.Argument(help="What users will type.", show_default=False)],
    kind: Annotated[
        str, typer.Option(metavar="segmenter|solver|reader|scheme|attack", help="What it will be.")
    ],
    folder: Annotated[
        Path | None,
        typer.Argument(help="A new folder; meshmark-NAME by default.", show_default=False),
    ] = None,
) -> None:
    """Write a distribution with a plugin called NAME that works, and its tests, to start from."""
    from meshmark.commands.new_plugin import new_plugin

    place = new_plugin(name, kind, folder)
    say(f"{place}: written; `pip install -e {place}`, then `meshmark plugins check {name}`")
