"""`python -m fuzz` in tests/: alters small inputs at random, and counts what commands do."""

from __future__ import annotations

import os

# Before anything is loaded: threads do not survive a fork.
os.environ.update(
    OPENBLAS_NUM_THREADS="1",
    OMP_NUM_THREADS="1",
    PXR_WORK_THREAD_LIMIT="1",
    MESHMARK_JOBS="1",
    TF_ENV_SETTING_ALERTS_ENABLED="0",
)

import argparse
import importlib
import re
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from functools import cache
from pathlib import Path

import typer.main

from .campaign import Campaign, Outcome
from .inputs import SHARES, Input
from .reducing import reduced
from .seeds import build, load, secret_file

STEP = 1000
LOADED = (
    *(
        "meshmark.cli.app",
        "meshmark.extension.registry",
        "meshmark.embedding.file",
        "meshmark.detection.verify",
    ),
    *("meshmark.usd.reading", "meshmark.usd.delivery", "meshmark.usd.writing"),
    *("meshmark_plugins.readers.gltf.reader", "DracoPy", "meshopt"),
    *("meshmark.reporting.report", "meshmark.commands.try_keys", "pyarrow.parquet"),
    *(f"meshmark.sources.isolation.{name}" for name in ("reading", "process", "child")),
    *("fast_simplification", "open3d", "potpourri3d", "pygeodesic.geodesic"),
    *("scipy.sparse.linalg", "scipy.spatial"),
)


def main() -> int:
    """Run a campaign; 1 if anything is wrong."""
    parser = argparse.ArgumentParser(prog="python -m fuzz", description=__doc__)
    parser.add_argument("--count", type=int, default=1000, help="inputs")
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", action="append", choices=list(SHARES), help="only these")
    parser.add_argument("--keep", type=Path, help="folder for what fails, made small")
    wanted = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="meshmark-fuzz-") as name:
        folder = Path(name).resolve()
        build(folder / "seeds")
        os.environ["MESHMARK_EVIDENCE_SECRET"] = str(secret_file(folder / "seeds"))
        _load_all()
        campaign = Campaign(
            load(folder / "seeds"), wanted.seed, wanted.kind or list(SHARES), folder / "run"
        )
        return _report(campaign, range(wanted.first, wanted.first + wanted.count), wanted.keep)


def _load_all() -> None:
    """Import what commands import, so that no child has to."""
    for name in LOADED:
        importlib.import_module(name)
    # Typer makes the commands anew for each call, which takes longer than to refuse an input.
    typer.main.get_command = cache(typer.main.get_command)


def _report(campaign: Campaign, indices: range, keep: Path | None) -> int:
    kinds: Counter[str] = Counter()
    codes: Counter[int] = Counter()
    wrong: Counter[str] = Counter()
    absorbed: Counter[str] = Counter()
    known: set[str] = set()
    start = time.monotonic()
    # What was counted until then is told, too.
    with suppress(KeyboardInterrupt):
        for done, outcome in enumerate(campaign.run(indices), start=1):
            given = campaign.make(outcome.index)
            kinds[given.kind] += 1
            codes.update(outcome.codes)
            if not outcome.faults:
                absorbed.update(f"{given.kind}: {fault}" for fault in outcome.at_first)
            else:
                wrong.update(f"{given.kind}: {fault}" for fault in outcome.faults)
                signature = _signature(given, outcome)
                print(f"input {outcome.index}: {signature}", flush=True)
                if keep is not None and signature not in known:
                    _keep(campaign, given, outcome, keep)
                known.add(signature)
            if done % STEP == 0:
                print(f"{done} inputs, {time.monotonic() - start:.0f} s, {dict(wrong)}", flush=True)
    print(f"{kinds.total()} inputs in {time.monotonic() - start:.0f} s: {_listed(kinds)}")
    print(f"{codes.total()} commands, exit codes: {_listed(codes)}")
    print(f"{absorbed.total()} faults within reading processes: {_listed(absorbed)}")
    print(f"{wrong.total()} faults of {len(known)} kinds: {_listed(wrong)}")
    return 1 if wrong else 0


def _listed(counts: Counter[str] | Counter[int]) -> str:
    return ", ".join(f"{what} {count}" for what, count in sorted(counts.items(), key=str)) or "none"


def _signature(given: Input, outcome: Outcome) -> str:
    """Name the fault and where it is, so that the same is kept once."""
    frames = re.findall(r'File "[^"]*/((?:meshmark|plugins)\w*/[^"]+)", line (\d+)', outcome.told)
    where = ":".join(frames[-1]) if frames else ""
    lines = outcome.told.strip().splitlines()
    last = re.sub(r"\d+", "0", lines[-1])[:100] if lines else ""
    return f"{given.kind}: {', '.join(outcome.faults)} {where} {last}"


def _keep(campaign: Campaign, given: Input, outcome: Outcome, folder: Path) -> None:
    small, last = reduced(campaign, given, outcome)
    place = folder / f"{given.kind}-{given.index}"
    for name, content in small.files.items():
        path = place / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    (place / "FAULT.txt").write_text(
        f"{', '.join(last.faults)}\naltered: {given.altered}\n"
        + "".join(f"meshmark {' '.join(command)}\n" for command in given.commands)
        + f"\n{last.told}\n"
    )


if __name__ == "__main__":
    sys.exit(main())
