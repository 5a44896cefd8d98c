"""Time our shape diameter against CGAL's on the same mesh, in turns, in the same run.

    python benchmarks/sdf_vs_cgal/compare.py [--runs 5] [--cores N] [--mesh FILE]

Wants g++ and CGAL's headers (Debian: libcgal-dev), and the reference elephant or another mesh.
Where one is missing it says so and ends with exit code 0. A JSON object goes to stdout, a table
row to stderr. CGAL's time is that of `sdf_values` alone: `cgal_s` for its rays, `cgal_default_s`
with the smoothing it does by default. Ours is that of `shape_diameter` as a user calls it, checks
and repair of missing values included, and `ratio` compares it with the rays.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import NoReturn

import numpy as np
from scipy.stats import spearmanr

from meshmark.arrays import FloatArray, IntArray

HERE = Path(__file__).resolve().parent
REPOSITORY = HERE.parent.parent
DATA = Path(os.environ.get("MESHMARK_DATA", REPOSITORY.parent / "shared" / "data"))
RAYS, CONE_ANGLE = 25, 120.0


def main() -> None:
    """Build CGAL's side, time both in turns, and print what came out."""
    options = _options()
    if options.cores is not None:
        # Before open3d starts its threads, which are as many as there are cores to run on.
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: options.cores])
    if not options.mesh.is_file():
        _skip(f"there is no {options.mesh.name} in the data folder; set MESHMARK_DATA")
    with tempfile.TemporaryDirectory() as folder:
        program = _compile(Path(folder))
        V, F = _first_frame(options.mesh)
        report = _compare(program, V, F, options.runs, Path(folder))
    report = {"mesh": options.mesh.name, **report, "cores": len(os.sched_getaffinity(0))}
    print(json.dumps(report, indent=2))
    _print_row(report)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Time shape diameters against CGAL's.")
    parser.add_argument("--mesh", type=Path, default=DATA / "elephant-gallop.usdc")
    parser.add_argument("--runs", type=int, default=3, help="times each side is measured")
    parser.add_argument("--cores", type=int, help="processors both sides may use")
    return parser.parse_args()


def _compile(folder: Path) -> Path:
    if shutil.which("g++") is None:
        _skip("there is no g++")
    program = folder / "cgal_sdf"
    flags = ["-O3", "-DNDEBUG", "-std=c++17", "-lgmp", "-lmpfr"]
    command = ["g++", str(HERE / "cgal_sdf.cpp"), "-o", str(program), *flags]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        missing = "CGAL/" in done.stderr and "No such file" in done.stderr
        _skip("CGAL's headers are not installed" if missing else done.stderr.strip()[-2000:])
    return program


def _first_frame(path: Path) -> tuple[FloatArray, IntArray]:
    import meshmark

    frame = meshmark.read(path).meshes[0][0]
    return frame.points, frame.faces


def _compare(
    program: Path, V: FloatArray, F: IntArray, runs: int, folder: Path
) -> dict[str, object]:
    from meshmark_plugins.segmenters.sdf import shape_diameter

    mesh, values = folder / "mesh.off", folder / "values.txt"
    _write_off(mesh, V, F)

    def cgal(smooth: str) -> float:
        command = [str(program), str(mesh), str(RAYS), str(CONE_ANGLE), smooth, str(values)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        return float(done.stdout)

    def ours() -> float:
        start = time.perf_counter()
        shape_diameter(V, F, cone_angle=CONE_ANGLE, rays=RAYS)
        return time.perf_counter() - start

    ours()  # the first call loads open3d
    timed = _in_turns(
        {"default": lambda: cgal("1"), "cgal": lambda: cgal("0"), "meshmark": ours}, runs
    )
    theirs = np.loadtxt(values)
    hit = theirs > 0.0
    diameter = shape_diameter(V, F, cone_angle=CONE_ANGLE, rays=RAYS)
    seconds = {name: median(times) for name, times in timed.items()}
    return {
        "faces": len(F),
        "rays": RAYS,
        "cone_angle": CONE_ANGLE,
        "runs": runs,
        "cgal_default_s": round(seconds["default"], 4),
        "cgal_s": round(seconds["cgal"], 4),
        "meshmark_s": round(seconds["meshmark"], 4),
        "ratio": round(seconds["cgal"] / seconds["meshmark"], 2),
        "ratio_worst": round(min(timed["cgal"]) / max(timed["meshmark"]), 2),
        "rank_correlation": round(float(spearmanr(theirs[hit], diameter[hit]).statistic), 4),
    }


def _in_turns(sides: dict[str, Callable[[], float]], runs: int) -> dict[str, list[float]]:
    """Measure each side once a round, so that a busy machine slows both."""
    timed: dict[str, list[float]] = {name: [] for name in sides}
    for _ in range(runs):
        for name, measure in sides.items():
            timed[name].append(measure())
    return timed


def _write_off(path: Path, V: FloatArray, F: IntArray) -> None:
    with path.open("w", encoding="ascii") as file:
        file.write(f"OFF\n{len(V)} {len(F)} 0\n")
        np.savetxt(file, V, fmt="%.17g")
        np.savetxt(file, np.column_stack([np.full(len(F), 3), F]), fmt="%d")


def _print_row(report: dict[str, object]) -> None:
    columns = (
        "mesh",
        "faces",
        "cores",
        "cgal_default_s",
        "cgal_s",
        "meshmark_s",
        "ratio",
        "ratio_worst",
    )
    for cells in (columns, ["---"] * len(columns), [report[name] for name in columns]):
        print("| " + " | ".join(map(str, cells)) + " |", file=sys.stderr)


def _skip(reason: str) -> NoReturn:
    print(f"skipped: {reason}", file=sys.stderr)
    raise SystemExit(0)


if __name__ == "__main__":
    main()
