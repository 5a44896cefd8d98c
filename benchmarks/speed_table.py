"""How long marking and verifying take, and how much memory: one table, row after row.

    python benchmarks/speed_table.py [--row NAME]... [--largest N] [--frames N] [--names N]

All rows take hours on two cores, most of them for `growth`, whose elephant has up to 680 thousand
points: `--row` chooses some, `--largest` leaves larger meshes out, `--frames` shortens animations.
Where CGAL is not installed (Debian: libcgal-dev), what is measured against it is left out.

Wall clock depends on what else the machine does, CPU less so. Ratios to CGAL are of one run.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from measuring import REPOSITORY, data_folder, table
from speed.bench import Bench, Line
from speed.rows import ROWS

COLUMNS = ("row", "figure", "CPU, s", "wall, s", "peak, MB", "private, MB", "CGALs, CPU (wall)")


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    options = _options(arguments)
    given = sys.argv[1:] if arguments is None else arguments
    print(f"`python benchmarks/speed_table.py {' '.join(given)}`".replace(" `", "`"), end=" ")
    print(f"at commit {_commit()}, on {os.cpu_count()} cores\n")
    print(table(COLUMNS, []), flush=True)
    with tempfile.TemporaryDirectory(prefix="meshmark-speed-") as folder:
        bench = Bench(
            data_folder(),
            Path(folder),
            frames=options.frames,
            largest=options.largest,
            names=options.names,
        )
        for name in options.row or ROWS:
            for line in ROWS[name](bench):
                print(f"| {' | '.join((name, *_cells(line)))} |", flush=True)


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Print the table of speed.")
    parser.add_argument("--row", action="append", choices=list(ROWS), help="all by default")
    parser.add_argument("--largest", type=int, help="most points of a mesh")
    parser.add_argument("--frames", type=int, help="most frames of an animation")
    parser.add_argument("--names", type=int, default=1000, help="recipients to try")
    return parser.parse_args(arguments)


def _commit() -> str:
    command = ["git", "-C", str(REPOSITORY), "describe", "--always", "--dirty"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stdout.strip() or "unknown"


def _cells(line: Line) -> list[str]:
    unit = line.unit
    ratio = "-"
    if unit is not None and line.cpu is not None and line.wall is not None:
        ratio = f"{line.cpu / unit.cpu:.3g} ({line.wall / unit.wall:.3g})"
    seconds = [_number(value, 2) for value in (line.cpu, line.wall)]
    memory = [_number(value, 0) for value in (line.peak_mb, line.private_mb)]
    return [line.figure, *seconds, *memory, ratio]


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


if __name__ == "__main__":
    main()
