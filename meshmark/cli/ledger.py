"""`meshmark ledger`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshmark.cli.console import put_json, say, warn
from meshmark.cli.options import JsonOption

if TYPE_CHECKING:
    from meshmark.ledger.store import Appended, Ledger

DAMAGED = 1
# What `list` leaves to `show`.
LONG = ("manifest", "reply", "roots")

ledger = typer.Typer(
    help="Keep a ledger of marked copies: which asset, for whom, with which key.",
    no_args_is_help=True,
)

LedgerOption = Annotated[
    str,
    typer.Option(
        "--ledger", metavar="URL", help="A file (SQLite), or postgresql://USER@HOST/NAME."
    ),
]
RootOption = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Certificates to trust, PEM."),
]
NumberArgument = Annotated[
    int, typer.Argument(metavar="NUMBER", help="Of the entry.", show_default=False)
]


@ledger.command("init")
def init_ledger(ledger: LedgerOption) -> None:
    """Make a ledger, or bring an older one to the newest schema."""
    from meshmark.ledger.extra import require_installed

    require_installed()
    from meshmark.ledger.schema import REVISION
    from meshmark.ledger.store import init

    name, before = init(ledger)
    done = "is up to date" if before == REVISION else "is ready"
    say(f"{name}: {done}, schema {REVISION}")


@ledger.command("list")
def list_entries(
    ledger: LedgerOption,
    asset: Annotated[str | None, typer.Option(help="Copies of this asset only.")] = None,
    recipient: Annotated[str | None, typer.Option(help="Copies for this recipient only.")] = None,
    json: JsonOption = False,
) -> None:
    """List marked copies and time stamps, one a line."""
    from meshmark.recipients import recipient_name

    name = None if recipient is None else recipient_name(recipient)
    found = opened(ledger).entries(asset=asset, recipient=name)
    if json:
        put_json({"entries": [_in_short(entry) for entry in found]})
        return
    for entry in found:
        typer.echo(f"{entry['sequence']:>6}  {entry['recorded_at'][:19]}Z  {_told(entry)}")


@ledger.command("show")
def show_entry(number: NumberArgument, ledger: LedgerOption) -> None:
    """Print an entry as JSON: the manifest, or the time stamp, and where all lies."""
    put_json(opened(ledger).entry(number))


@ledger.command("verify")
def verify_chain(
    ledger: LedgerOption,
    root: RootOption = None,
    head: Annotated[
        str | None,
        typer.Option(
            metavar="HASH", help="Hash of an entry, noted earlier, that must be in the chain."
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Find every entry that was changed, is missing or was put in another place."""
    kept = opened(ledger, "rfc3161_client")
    from meshmark.ledger.checking import check

    found = check(kept, root, head)
    if json:
        put_json(found.as_json())
    for finding in found.findings:
        say(f"{found.ledger}: entry {finding.sequence} {finding.what}")
    for stamp in found.stamps:
        say(f"{found.ledger}: entries 1 to {stamp.of} were there at {stamp.time}")
    last = f"{found.entries} entr{'y' if found.entries == 1 else 'ies'}, the last {found.head}"
    say(f"{found.ledger}: {last}" if found.findings else f"{found.ledger}: whole: {last}")
    if found.findings:
        raise typer.Exit(DAMAGED)


@ledger.command("export")
def export_entries(
    ledger: LedgerOption,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Where to; stdout by default.")
    ] = None,
) -> None:
    """Write all entries and their hashes as JSON, one a line."""
    from meshmark.files.atomic import written_beside

    links = opened(ledger).links()
    if output is None:
        for link in links:
            typer.echo(link.as_line())
        return
    with written_beside(output) as file:
        for link in links:
            file.write(f"{link.as_line()}\n".encode())


@ledger.command("timestamp")
def stamp_chain(
    ledger: LedgerOption,
    tsa: Annotated[
        str | None,
        typer.Option(metavar="URL", help="Ask this time-stamping authority (RFC 3161)."),
    ] = None,
    query: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write a request, to be taken to an authority."),
    ] = None,
    reply: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Read the authority's reply to it.")
    ] = None,
    root: RootOption = None,
) -> None:
    """Let an authority stamp the end of the chain, and so all entries; keep its reply."""
    from meshmark.errors import UsageError

    if (tsa is not None) + (query is not None) + (reply is not None) != 1:
        raise UsageError("one of --tsa, --query and --reply is needed")
    if query is None and root is None:
        raise UsageError("--root is needed: the certificates to verify the reply against")
    kept = opened(ledger, "rfc3161_client")
    from meshmark.ledger.stamping import stamp_by, stamp_from, write_request

    if query is not None:
        say(f"{query}: a request for a time stamp on entry {write_request(kept, query)}")
        return
    assert root is not None
    if tsa is not None:
        done = stamp_by(kept, tsa, root)
    else:
        assert reply is not None
        done = stamp_from(kept, reply, root)
    tell_appended(done, kept.name)
    say(f"{kept.name}: {_told(done.link.entry)}")


@dataclass
class Recorder:
    """Records what `embed` has written; `mark_file` calls it."""

    ledger: Ledger
    asset: str | None
    version: str | None
    output: Path
    master: Path | None
    done: Appended | None = None

    @classmethod
    def of(
        cls,
        where: str,
        asset: str | None,
        version: str | None,
        output: Path,
        master: Path | None,
    ) -> Recorder:
        """Open a ledger to write to."""
        kept = opened(where)
        from meshmark.ledger.marks import asset_name

        kept.require_writable()
        asset, version = (name and asset_name(name) for name in (asset, version))
        return cls(kept, asset, version, output, master)

    def __call__(self, manifest: dict[str, Any]) -> None:
        """Record a marked copy by its manifest."""
        from meshmark.embedding.manifest import output_hashes
        from meshmark.ledger.marks import mark_of

        master = None
        if self.master is not None:
            place = str(self.master.absolute())
            master = {"path": place, "files": output_hashes(self.master)}
        mark = mark_of(manifest, self.output, asset=self.asset, version=self.version, master=master)
        self.done = self.ledger.append(mark)

    def tell(self) -> None:
        """Say which entry it became; none after a dry run."""
        if self.done is not None:
            tell_appended(self.done, self.ledger.name)


def tell_appended(done: Appended, name: str) -> None:
    """Say which entry it became, and whether this clock can be right."""
    told = "recorded" if done.new else "was recorded before"
    say(f"{name}: entry {done.link.sequence} {told}")
    if done.behind:
        warn(
            f"{name}: this clock is {done.behind:.0f} s behind that of the entry before: "
            "one of the two is wrong"
        )


def opened(where: str, *modules: str) -> Ledger:
    """Open a ledger that is there, if what it needs, and further modules, are installed."""
    from meshmark.ledger.extra import require_installed

    require_installed(*modules)
    from meshmark.ledger.store import Ledger

    return Ledger(where)


def _in_short(entry: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in entry.items() if name not in LONG}


def _told(entry: dict[str, Any]) -> str:
    if entry["kind"] == "timestamp":
        return f"time stamp on entries 1 to {entry['of']}, {entry['time']}"
    whose = f"for {entry['recipient']}" if entry["recipient"] else "for nobody by name"
    if entry["kind"] == "waiver":
        return f"{entry['asset']} {entry['version']} {whose}, unmarked: {entry['waiver']}"
    return f"{entry['asset']} {entry['version']} {whose}, key {entry['key_id']}: {entry['output']}"
