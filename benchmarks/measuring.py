"""What the benchmark scripts share: the data folder, timed commands, tables."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from threading import Event

REPOSITORY = Path(__file__).resolve().parent.parent
WATCH_EVERY = 0.1  # seconds
PAGES = REPOSITORY / "docs" / "benchmarks"


def data_folder() -> Path:
    """Return the folder of the reference assets, or leave with a reason."""
    folder = Path(os.environ.get("MESHMARK_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        sys.exit(f"reference assets are not at {folder}; set MESHMARK_DATA to their folder")
    return folder


@dataclass(frozen=True)
class Run:
    """A command that was run: exit code, wall seconds, peak memory of its largest process.

    `cpu` is the CPU seconds of all its processes.
    Of the peak, `private_mb` is what the process asked for itself; the rest are pages of files,
    of which the system drops those it needs for something else. NaN where that is not told.
    """

    code: int
    seconds: float
    cpu: float
    peak_mb: float
    private_mb: float
    stdout: str


def run(*command: object, cwd: Path) -> Run:
    """Run a command, and measure it."""
    start = time.perf_counter()
    with (cwd / "stdout").open("w+") as out:
        process = subprocess.Popen(
            [sys.executable, "-m", "meshmark", *map(str, command)],
            cwd=cwd,
            stdout=out,
            process_group=0,
            # A busy machine is no reason to give up reading.
            env={"MESHMARK_READ_SECONDS": "600", **os.environ},
        )
        ended = Event()
        with ThreadPoolExecutor(1) as threads:
            private = threads.submit(_largest_private_mb, process.pid, ended)
            _, status, usage = os.wait4(process.pid, 0)
            ended.set()
        process.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        text = out.read()
    seconds = time.perf_counter() - start
    cpu, peak_mb = usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024
    return Run(process.returncode, seconds, cpu, peak_mb, private.result(), text)


def _largest_private_mb(group: int, ended: Event) -> float:
    """Watch the processes of a group, and return the most private memory one of them had."""
    most = float("nan")
    while not ended.wait(WATCH_EVERY):
        for status in Path("/proc").glob("[0-9]*/status"):
            try:
                if os.getpgid(int(status.parent.name)) == group:
                    [line] = re.findall(r"RssAnon:\s+(\d+) kB", status.read_text())
                    most = max(int(line) / 1024, most)
            except (OSError, ValueError):
                # It has ended meanwhile.
                continue
    return most


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Lay out a Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def repeat(source: Path, output: Path, times: int) -> None:
    """Write a stage of one mesh again, its frames several times over."""
    from pxr import Usd, UsdGeom

    shutil.copy(source, output)
    stage = Usd.Stage.Open(str(output))
    [mesh] = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    points = UsdGeom.Mesh(mesh).GetPointsAttr()
    samples = points.GetTimeSamples()
    for cycle in range(1, times):
        for code in samples:
            points.Set(points.Get(code), code + cycle * len(samples))
    stage.SetEndTimeCode(times * len(samples))
    stage.Save()
