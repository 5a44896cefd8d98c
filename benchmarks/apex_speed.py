"""How long `apex` takes and where the time goes, and whether memory grows with the frames.

Usage: python benchmarks/apex_speed.py
It runs for some minutes on two cores, and writes docs/benchmarks/apex-speed.md.
"""

from __future__ import annotations

import importlib
import json
import os
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from measuring import PAGES, Run, data_folder, repeat, run, table
from meshmark import read
from meshmark.detection.extraction import Extraction
from meshmark.detection.significance import judge
from meshmark.embedding.mesh import embed_animation
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key

KEY = Key(bytes(range(32)))
FRAMES = 10
APEX = "meshmark_plugins.schemes.apex"
# Where a function is looked up, and the stage its own time counts for: what it calls counts for
# the stages of what is called.
EMBED_STAGES = (
    (f"{APEX}.marking.plan", "require_capacity", "finding lasting anchors"),
    (f"{APEX}.marking.plan", "anchors_in_poses", "finding anchors in poses"),
    (f"{APEX}.anchors.geodesics", "GeodesicDistances.__init__", "distances: factors"),
    (f"{APEX}.anchors.geodesics", "GeodesicDistances.from_vertex", "distances: solves"),
    (
        f"{APEX}.marking.pose_constraints",
        "PoseConstraints.__call__",
        "chips and gradients of poses",
    ),
    ("meshmark.mesh.closest_points", "ClosestPoints.points", "closest points"),
    (f"{APEX}.marking.keyframe_solver", "solve_displacement", "solving for displacements"),
    (f"{APEX}.marking.fold_smoother", "FoldSmoother.smooth_folds", "smoothing folds"),
    (f"{APEX}.marking.keyframe_solver", "energy_over_poses", "energies"),
    ("meshmark.mesh.deformation", "Deformation.gradients", "deformation gradients"),
    (f"{APEX}.marking.displacement_transfer", "allowed_shares", "holding faces back"),
    (f"{APEX}.marking.plan", "restrain", "holding faces back"),
    (f"{APEX}.marking.plan", "fit_to_surface", "fitting to surfaces"),
    (f"{APEX}.marking.plan", "surface_distance", "keeping to the limit"),
)
LOOK_STAGES = (
    ("meshmark.detection.observer", "unsmooth", "undoing smoothing"),
    (f"{APEX}.anchors.detect", "large_components", "components"),
    (f"{APEX}.anchors.geodesics", "GeodesicDistances.__init__", "distances: factors"),
    (f"{APEX}.anchors.geodesics", "GeodesicDistances.from_vertex", "distances: solves"),
    (f"{APEX}.anchors.detect", "surface_anchors", "anchors"),
    (f"{APEX}.scheme", "whitening_weights", "whitening"),
    (f"{APEX}.scheme", "radial_histograms", "histograms"),
    (f"{APEX}.scheme", "measure_chips", "chips"),
)


class Stages:
    """Adds up the time spent in each stage itself, without what it calls."""

    def __init__(self) -> None:
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self._inner: list[float] = []

    @contextmanager
    def within(self, stage: str) -> Iterator[None]:
        """Count the time of a block for a stage, less that of the stages inside."""
        self._inner.append(0.0)
        start = time.perf_counter()
        try:
            yield
        finally:
            elapsed = time.perf_counter() - start
            self.seconds[stage] += elapsed - self._inner.pop()
            if self._inner:
                self._inner[-1] += elapsed

    def watch(self, function: Callable[..., Any], stage: str) -> Callable[..., Any]:
        """Wrap a function so that its time is counted."""

        def watched(*args: Any, **kwargs: Any) -> Any:
            with self.within(stage):
                return function(*args, **kwargs)

        return watched


@contextmanager
def watched(stages: Stages, places: tuple[tuple[str, str, str], ...]) -> Iterator[None]:
    """Watch functions and methods where they are looked up."""
    undo = []
    for module, name, stage in places:
        owner: Any = importlib.import_module(module)
        *path, last = name.split(".")
        for part in path:
            owner = getattr(owner, part)
        original = getattr(owner, last)
        undo.append((owner, last, original))
        setattr(owner, last, stages.watch(original, stage))
    try:
        yield
    finally:
        for owner, last, original in undo:
            setattr(owner, last, original)


def main() -> None:
    """Measure, and write the page."""
    data = data_folder()
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        run("keygen", "k", cwd=work)
        totals = [_total(work, data, name) for name in ("horse-gallop", "elephant-gallop")]
        memory = _memory(work, data / "horse-gallop.usdc")
    stages = {name: _stages(data / f"{name}.usdc") for name in ("horse-gallop", "elephant-gallop")}
    (PAGES / "apex-speed.md").write_text(_page(totals, stages, memory))


def _total(work: Path, data: Path, name: str) -> list[object]:
    marked = f"{name}.usda"
    made = run("embed", data / f"{name}.usdc", "-o", marked, "--key", "k", cwd=work)
    manifest = json.loads((work / f"{marked}.meshmark.json").read_text())["prims"][0]
    row: list[object] = [
        name,
        manifest["points"],
        manifest["frames"],
        f"{made.seconds:.0f}",
        f"{manifest['frames'] / made.seconds:.2f}",
        f"{made.peak_mb:.0f}",
    ]
    run("attack", "noise", marked, "-o", "noisy.usdc", "-p", "amplitude=0.005", cwd=work)
    run("attack", "smoothing", marked, "-o", "smooth.usdc", "-p", "iterations=30", cwd=work)
    for copy in (marked, "noisy.usdc", "smooth.usdc"):
        asked = run("verify", copy, "--key", "k", "--scheme", "apex", cwd=work)
        row.append(f"{asked.seconds:.1f}" if asked.code == 0 else f"({asked.seconds:.1f})")
    return row


def _memory(work: Path, source: Path) -> list[list[object]]:
    long = work / "long.usdc"
    repeat(source, long, 5)
    rows: list[list[object]] = []
    for label, path in (("48", source), ("240 (the cycle repeated)", long)):
        made = run("embed", path, "-o", "m.usdc", "--key", "k", cwd=work)
        asked = run("verify", "m.usdc", "--key", "k", "--scheme", "apex", "--frames", ":", cwd=work)
        rows.append([label, *_figures(made), *_figures(asked)])
    return rows


def _figures(done: Run) -> list[str]:
    return [f"{figure:.0f}" for figure in (done.seconds, done.peak_mb, done.private_mb)]


def _stages(source: Path) -> tuple[Stages, Stages]:
    """Time the stages of marking `FRAMES` frames, and of looking at one, in one process."""
    animation = read(source).meshes[0].select(range(FRAMES))
    scheme = Recipe("apex").build()
    marking, looking = Stages(), Stages()
    with watched(marking, EMBED_STAGES), marking.within("everything else"):
        marked = embed_animation(animation, scheme, "apex", KEY, jobs=1).animation
    with watched(looking, LOOK_STAGES), looking.within("everything else"):
        evidence = Extraction(marked, scheme, "apex").look([0])
        with looking.within("judging"):
            judge(evidence, KEY)
    return marking, looking


def _page(
    totals: list[list[object]],
    stages: dict[str, tuple[Stages, Stages]],
    memory: list[list[object]],
) -> str:
    parts = [
        "# Speed of `apex`",
        "Written by `python benchmarks/apex_speed.py`, on "
        f"{os.cpu_count()} cores. On this page you find how long marking and verifying take, stage "
        "by stage, and how much memory. Seconds depend on the machine; compare shares, not "
        "seconds.",
        "## Whole animations",
        "`meshmark embed SOURCE -o OUTPUT --key k`, including measuring the distortion and "
        "verifying the written file; `meshmark verify` (`--frames auto`) of the copy unchanged, "
        "with noise of 0.5 %, and smoothed 30 times. In brackets: not found.",
        table(
            (
                *("animation", "points", "frames", "embed, s", "frames a second", "peak, MB"),
                *("verify, s", "noise", "smoothing"),
            ),
            totals,
        ),
        "## Stage by stage",
        f"One process. Marking {FRAMES} frames:",
        _stage_table({name: marking for name, (marking, _) in stages.items()}),
        "Measuring one frame, unchanged and with 10, 30 and 50 iterations of smoothing undone:",
        _stage_table({name: looking for name, (_, looking) in stages.items()}),
        "Most of the time of marking goes into two tasks. Poses are measured (chips with their "
        "gradients, and distances) in parallel. Beside that, up to two displacements are solved "
        "for at a time.",
        "## Memory",
        "Peak of the largest process, horse, and its private part. The rest are pages of files, "
        "mostly of libraries, but also of the animation; the system drops them when it needs "
        "memory. Verification measures every frame:",
        table(
            (
                *("frames", "embed, s", "peak, MB", "private, MB"),
                *("verify, s", "peak, MB", "private, MB"),
            ),
            memory,
        ),
    ]
    return "\n\n".join(parts) + "\n"


def _stage_table(stages: dict[str, Stages]) -> str:
    names = sorted(
        {stage for found in stages.values() for stage in found.seconds},
        key=lambda stage: -max(found.seconds[stage] for found in stages.values()),
    )
    rows = []
    for stage in names:
        row: list[object] = [stage]
        for found in stages.values():
            total = sum(found.seconds.values())
            row += [f"{found.seconds[stage]:.2f}", f"{100 * found.seconds[stage] / total:.0f} %"]
        rows.append(row)
    header = ["stage"]
    for name in stages:
        header += [f"{name}, s", "share"]
    return table(header, rows)


if __name__ == "__main__":
    main()
