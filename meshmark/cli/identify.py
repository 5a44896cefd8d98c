"""`meshmark identify`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from meshmark.cli.batch import (
    Batch,
    JobsOption,
    JsonlOption,
    ResumeOption,
    SchedulerOption,
    TimeoutOption,
)
from meshmark.cli.console import complain, put_json, say, warn
from meshmark.cli.ledger import LedgerOption, opened
from meshmark.cli.options import JsonOption, TrustedOption

if TYPE_CHECKING:
    from meshmark.commands.identification import Candidate, Identification
    from meshmark.commands.outcome import Outcome

KEYS_VARIABLE, PATHS_VARIABLE = "MESHMARK_KEYS", "MESHMARK_PATHS"
# Candidates that are printed.
MOST_SHOWN = 4


def identify(
    suspects: Annotated[
        list[str],
        typer.Argument(
            metavar="SUSPECT|FOLDER|@LIST...",
            help="Copies to identify; all in a FOLDER and below; patterns, in quotes; those that "
            "a file names one a line (@@NAME for the file @NAME).",
            show_default=False,
        ),
    ],
    ledger: LedgerOption,
    fpr: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Largest p that counts as marked.")
    ] = 1e-6,
    most: Annotated[
        int,
        typer.Option(
            min=0, help="Originals to lay each SUSPECT upon, those first it is most like."
        ),
    ] = 8,
    everything: Annotated[
        bool,
        typer.Option("--all", help="Go on where an asset was found: SUSPECT may hold several."),
    ] = False,
    moves: Annotated[
        list[str],
        typer.Option(
            "--map",
            metavar="OLD=NEW",
            help="What the ledger says is in the folder OLD is in NEW now.",
        ),
    ] = [],  # noqa: B006 (typer makes a new list each time)
    trusted: TrustedOption = False,
    json: JsonOption = False,
    jsonl: JsonlOption = False,
    resume: ResumeOption = None,
    jobs: JobsOption = None,
    timeout: TimeoutOption = None,
    scheduler: SchedulerOption = None,
) -> None:
    """Say which asset of the ledger each SUSPECT is a copy of, which version, and whose copy."""
    from meshmark.errors import UsageError

    if not 0.0 < fpr < 1.0:
        raise UsageError(f"--fpr must lie between 0 and 1, not {fpr:g}")
    batch = Batch("identify", jsonl, resume, jobs, scheduler, timeout)
    batch.require_sense(json)
    folder = os.environ.get(KEYS_VARIABLE)
    if not folder:
        raise UsageError(f"{KEYS_VARIABLE} must name the folder of key files (*.key)")
    kept = opened(ledger)
    from meshmark.ledger.moved import moved, moves_of

    places = moves_of(moves, os.environ.get(PATHS_VARIABLE))
    from meshmark.commands.identification import Request, ledger_facts
    from meshmark.commands.identify import identify_file
    from meshmark.keys import keys_in
    from meshmark.ledger.origins import origins
    from meshmark.sources.listing import listed

    known = [moved(origin, places) for origin in origins(kept.entries())]
    request = Request(
        origins=known,
        key_folder=Path(folder),
        key_ids=sorted(keys_in(Path(folder))),
        fpr=fpr,
        most=most,
        everything=everything,
        trusted=trusted,
        recorded=batch.recorded,
        timeout=timeout,
        ledger=ledger_facts(known) if batch.recorded else {},
    )
    named = listed(suspects)
    found: dict[str, Identification] = {}

    def told(outcome: Outcome[Identification]) -> None:
        if outcome.verdict is None:
            complain(outcome.error)
            return
        _tell(outcome.verdict)
        if json:
            found[outcome.source] = outcome.verdict

    tally = batch.run(named, request, identify_file, told)
    if json:
        answers = [found[each].as_json() for each in named if each in found]
        put_json({"ledger": kept.name, "suspects": answers})
    tally.end()


def _tell(found: Identification) -> None:
    said = found.as_json()
    if said["asset"] is not None:
        whose = f", copy of {said['recipient']}" if said["recipient"] else ""
        what = f"{said['asset']} {said['version']}{whose}, by its {said['told_by']}"
        if said["entries"]:
            what += f", entry {', '.join(map(str, said['entries']))}"
    elif found.verdict == "marked":
        whose = f", copy of {said['recipient']}" if said["recipient"] else ""
        what = f"by key {said['key_id']}{whose}; which asset is not known"
    else:
        what = f"{len(found.candidates)} candidates"
    say(
        f"{found.source}: {found.verdict}: {what}, log10 p {found.log10_p:.2f} "
        f"for {found.hypotheses:,} keys and names tried"
    )
    for candidate in found.candidates[:MOST_SHOWN]:
        say(f"  {_told(candidate)}")
    for note in found.notes:
        warn(note)


def _told(candidate: Candidate) -> str:
    origin, verdict = candidate.origin, candidate.verdict
    said = f"{verdict.verdict}, log10 p {verdict.log10_p:.2f}"
    if origin is None:
        return f"alone, by key {candidate.key_id}: {said}"
    said = f"beside {origin.asset} {origin.version}: {said}"
    if candidate.informed is not None and candidate.informed.prims:
        said += f", beside the original alone {candidate.informed.log10_p:.2f}"
    return f"{said}; {candidate.why}" if candidate.why else said
