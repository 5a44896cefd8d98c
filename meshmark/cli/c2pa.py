"""`meshmark c2pa`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from meshmark.cli.console import INCONCLUSIVE, NOT_MARKED, complain, put_json, say
from meshmark.cli.ledger import opened
from meshmark.cli.options import JsonOption

if TYPE_CHECKING:
    from meshmark.commands.credentials import Answer

c2pa = typer.Typer(
    help="Check the content credentials (C2PA) beside a marked file.", no_args_is_help=True
)


@c2pa.callback()
def _commands() -> None:
    """Check the content credentials (C2PA) beside a marked file."""


@c2pa.command("verify")
def verify_sidecar(
    file: Annotated[Path, typer.Argument(help="What was signed.", show_default=False)],
    sidecar: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="By default FILE with the suffix .c2pa."),
    ] = None,
    anchors: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Certificates to trust, PEM: of signers, and of time stamps."
        ),
    ] = None,
    ledger: Annotated[
        str | None, typer.Option(metavar="URL", help="Look the record up in this ledger.")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Check who signed FILE's sidecar, that it is about FILE, and what it is a record of."""
    from meshmark.c2pa.sidecar import require_installed, sidecar_path

    require_installed()
    from meshmark.commands.credentials import INVALID, UNKNOWN, verify_credentials

    found = verify_credentials(
        file,
        sidecar_path(file) if sidecar is None else sidecar,
        anchors=anchors,
        entries=None if ledger is None else opened(ledger).entries(),
    )
    if json:
        put_json(found.as_json())
    _tell(found)
    code = {INVALID: NOT_MARKED, UNKNOWN: INCONCLUSIVE}.get(found.verdict, 0)
    if code:
        raise typer.Exit(code)


def _tell(found: Answer) -> None:
    said = found.credentials
    who = f"{said.signer} of {said.issuer}" if said.issuer else f"{said.signer}"
    when = f", stamped {said.stamped}" if said.stamped else ""
    say(f"{found.file}: {found.verdict}: signed by {_readable(who)}{when}")
    for problem in found.problems:
        complain(f"{found.sidecar}: {_readable(problem)}")
    for algorithm, value in said.bindings:
        say(f"  marked by {_readable(algorithm)}, record {_readable(value)}")
    if found.entries:
        say(f"  entries {', '.join(map(str, found.entries))} of the ledger")


def _readable(text: str) -> str:
    """Show what whoever signed has written, and nothing that a terminal would obey."""
    return "".join(
        letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in text
    )
