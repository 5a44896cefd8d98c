"""`meshmark try`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from meshmark.cli.console import complain, exit_code, few, frame_progress, put_json, say, warn
from meshmark.cli.options import JsonOption, load_key, read_recipients

if TYPE_CHECKING:
    from meshmark.commands.trials import Trial

# Sources that are printed, unless all are asked for.
MOST_SHOWN = 20


def try_keys(
    store: Annotated[
        Path, typer.Option("--store", metavar="FOLDER", help="What `verify --store` kept.")
    ],
    key: Annotated[
        list[Path],
        typer.Option(
            "--key",
            metavar="FILE|FOLDER",
            help="A key file, or a folder of them (*.key); may be given several times.",
        ),
    ],
    recipient: Annotated[
        list[str],
        typer.Option(
            "--recipient",
            metavar="NAME|@FILE",
            help="A recipient to try of each key (@@NAME for @NAME), or a file of names, one a "
            "line.",
        ),
    ] = [],  # noqa: B006
    unauthenticated: Annotated[
        bool,
        typer.Option(
            "--unauthenticated-evidence",
            help="Report what evidence says although it may be forged; the answer is inconclusive.",
        ),
    ] = False,
    fpr: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Largest p that counts as marked.")
    ] = 1e-6,
    everything: Annotated[
        bool, typer.Option("--all", help="Print every source, not only twenty.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Try keys on all evidence of a store, without reading any geometry again."""
    from meshmark.errors import UsageError

    if not 0.0 < fpr < 1.0:
        raise UsageError(f"--fpr must lie between 0 and 1, not {fpr:g}")
    from meshmark.detection.evidence_store import EvidenceStore, require_arrow

    require_arrow()
    names = read_recipients(recipient)
    files = _key_files(key)
    from meshmark.commands.try_keys import KeyFiles, try_keys
    from meshmark.workers.ordered_map import default_jobs

    with frame_progress() as progress:
        trials, refusals = try_keys(
            EvidenceStore(store),
            KeyFiles(files),
            recipients=names,
            fpr=fpr,
            authenticated=not unauthenticated,
            jobs=default_jobs(),
            progress=lambda done, total: progress("try", str(store), done, total),
        )
    for refusal in refusals:
        complain(refusal.error)
    say(
        f"{store}: {_counted(len(trials), 'source')}, {_counted(len(files), 'key')}, "
        f"{_counted(1 + len(names), 'name')} of each"
    )
    few([_told(trial) for trial in trials], everything, say, MOST_SHOWN)
    if json:
        put_json(
            {
                "store": str(store),
                "keys": len(files),
                "names": 1 + len(names),
                "refused": len(refusals),
                "sources": [trial.as_json() for trial in trials],
            }
        )
    worst = max((refusal.exit_code for refusal in refusals), default=0)
    code = worst or exit_code(trial.verdict for trial in trials)
    if not trials and not worst:
        warn(f"{store}: nothing is kept there")
        code = exit_code(["inconclusive"])
    if code:
        raise typer.Exit(code)


def _counted(n: int, what: str) -> str:
    return f"{n:,} {what}{'' if n == 1 else 's'}"


def _key_files(given: Sequence[Path]) -> list[Path]:
    """List the file of each key once."""
    from meshmark.errors import InputError
    from meshmark.keys import Key, key_files

    files: dict[str, Path] = {}
    for path in given:
        if not path.is_dir():
            files.setdefault(load_key(path).id, path)
            continue
        found = key_files(path)
        if not found:
            raise InputError("holds no key file (*.key)", source=path)
        for file in found:
            files.setdefault(Key.load(file).id, file)
    return list(files.values())


def _told(trial: Trial) -> str:
    p = "above the rate" if trial.log10_p is None else f"{trial.log10_p:.2f}"
    said = [f"{trial.source}: {trial.verdict}, log10 p {p}"]
    for match in trial.matches:
        whose = [one.recipient or "the owner" for one in match.verdict.recipients]
        said.append(
            f"by key {match.key_id}, copy of {' and '.join(whose)}, "
            f"log10 p {match.verdict.log10_p:.2f}"
        )
    return "; ".join(said)
