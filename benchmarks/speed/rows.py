"""The rows of the table of speed: each yields its lines as they are measured."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from measuring import repeat
from meshmark import read
from meshmark.detection.decision import decide
from meshmark.detection.gathering import gather
from meshmark.detection.informed import gather_informed
from meshmark.detection.verdict import Verdict
from meshmark.detection.verify import judge_all
from meshmark.embedding.asset import embed
from meshmark.extension.recipe import default_layers
from speed.bench import Bench, Line
from speed.shape_diameter import SDF_VALUES, Times, compare
from speed.stages import Stages, stages_of

# Frames of large meshes, and of the unmarked horse.
FRAMES = 12
# Frames by which growth and stages are measured.
FEW = 4
# How often the long animation repeats the short one.
CYCLES = 10
# Meshes by which growth is fitted: the elephant with so many edges collapsed, or subdivided.
COLLAPSED, SUBDIVISIONS = 0.8, (0, 1, 2)
ATTACKS = {
    "unchanged": (),
    "noise 0.5 %": ("noise", "-p", "amplitude=0.005"),
    "smoothed 30 times": ("smoothing", "-p", "iterations=30"),
}


def elephant(bench: Bench) -> Iterator[Line]:
    """Mark the elephant."""
    before, (path, done), after = bench.unit(), bench.marked("elephant-gallop"), bench.unit()
    unit = before and after and Times((before.cpu + after.cpu) / 2, (before.wall + after.wall) / 2)
    if unit is not None:
        yield Line(f"{SDF_VALUES}, first frame", unit.cpu, unit.wall, unit=unit)
    yield Line.of(f"embed, {_frames(path)}", done, unit)


def horse(bench: Bench) -> Iterator[Line]:
    """Mark the horse."""
    path, done = bench.marked("horse-gallop")
    yield Line.of(f"embed, {_frames(path)}", done)


def attacked(bench: Bench) -> Iterator[Line]:
    """Verify the marked elephant, attacked."""
    path, _ = bench.marked("elephant-gallop")
    for name, attack in ATTACKS.items():
        copy = path
        if attack:
            copy = bench.work / "attacked.usdc"
            bench.run("attack", attack[0], path, "-o", copy, *attack[1:])
        done = bench.run("verify", copy, "--key", "k", "--json", codes=(0, 1, 4))
        [asset] = json.loads(done.stdout)["assets"]
        yield Line.of(f"verify, {name}: {asset['verdict']}", done, bench.unit())


def unmarked(bench: Bench) -> Iterator[Line]:
    """Verify the unmarked horse: every look is taken."""
    path = bench.cut("horse-gallop", FRAMES)
    done = bench.run("verify", path, "--key", "k", codes=(1, 4))
    yield Line.of(f"verify, {_frames(path)}", done)


def growth(bench: Bench) -> Iterator[Line]:
    """Mark and verify the elephant coarser and finer, and fit how the time grows."""
    sizes, embeds, verifies = [], [], []
    for path in _sizes(bench):
        mesh = read(path).meshes[0]
        n = mesh[0].topology.n_points
        copy = bench.work / "sized.usdc"
        made = bench.run("embed", path, "-o", copy, "--key", "k")
        yield Line.of(f"embed, {n} points, {_frames(path)}", made)
        asked = bench.run("verify", copy, "--key", "k", "--frames", ":", codes=(0, 1, 4))
        yield Line.of(f"verify all, {n} points, {_frames(path)}", asked)
        sizes, embeds, verifies = [*sizes, n], [*embeds, made.cpu], [*verifies, asked.cpu]
    if len(sizes) > 1:
        for name, seconds in (("embed", embeds), ("verify", verifies)):
            exponent = np.polyfit(np.log(sizes), np.log(seconds), 1)[0]
            yield Line(f"CPU of {name} grows as points to the power of {exponent:.2f}")


def _sizes(bench: Bench) -> Iterator[Path]:
    """Write the elephant in several sizes, from 8 to 680 thousand points."""
    few = bench.cut("elephant-gallop", FRAMES)
    coarse = bench.work / "coarse.usdc"
    bench.run("attack", "simplification", few, "-o", coarse, "-p", f"ratio={COLLAPSED}")
    if bench.allows(read(coarse).meshes[0][0].topology.n_points):
        yield coarse
    points = read(few).meshes[0][0].topology.n_points
    for steps in SUBDIVISIONS:
        if not bench.allows(points * 4**steps):
            return
        path = few
        if steps:
            path = bench.work / "fine.usdc"
            bench.run("attack", "subdivision", few, "-o", path, "-p", f"steps={steps}")
        yield path


def diameters(bench: Bench) -> Iterator[Line]:
    """Compute shape diameters, and let CGAL do so."""
    for name in ("elephant-gallop", "horse-gallop"):
        V, F = bench.first_frame(name)
        if bench.allows(len(V)):
            times = compare(bench.cgal, V, F)
            for what, each in times.items():
                unit = times.get(SDF_VALUES)
                yield Line(f"{name}, {what}", each.cpu, each.wall, unit=unit)


def memory(bench: Bench) -> Iterator[Line]:
    """Mark and verify the horse, and the horse's frames many times over."""
    short, long = bench.cut("horse-gallop"), bench.work / "long.usdc"
    repeat(short, long, CYCLES)
    copy = bench.work / "repeated.usdc"
    for path in (short, long):
        yield Line.of(f"embed, {_frames(path)}", bench.run("embed", path, "-o", copy, "--key", "k"))
        asked = bench.run("verify", copy, "--key", "k", "--frames", ":", codes=(0, 1, 4))
        yield Line.of(f"verify all, {_frames(path)}", asked)


def recipients(bench: Bench) -> Iterator[Line]:
    """Try many recipients on evidence of the horse, blind and beside the original."""
    original = bench.animation("horse-gallop", FEW)
    names = [f"recipient {n:04d}" for n in range(bench.names)]
    apex, *_ = layers = default_layers()
    blind = embed(original, bench.key, recipe=apex, recipient=names[-1]).asset
    one = replace(blind, meshes=(blind.meshes[0].select([0]),))
    looks = {
        "one frame": gather(one, recipes=[apex], restored=False, parts=False),
        f"{len(original)} frames, smoothing undone": gather(blind, recipes=[apex], parts=False),
    }
    for what, evidence in looks.items():
        yield _tried(what, partial(judge_all, evidence, bench.key), names)
    both = embed(original, bench.key, recipe=layers, recipient=names[-1])
    informed = [layer for layer in layers if layer.informed]
    beside = gather_informed(both.asset, both.original, informed, master=both.master)
    judge = partial(decide, both.original.source, beside.items, bench.key)
    yield _tried("beside the original", judge, names)


def _tried(what: str, judge: Callable[..., Verdict], names: list[str]) -> Line:
    judge(recipients=names[:1])  # what is kept for all names is made now
    cpu, wall = time.process_time(), time.perf_counter()
    verdict = judge(recipients=names)
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    found = "the right one found" if verdict.recipient == names[-1] else "the right one not found"
    return Line(f"{len(names)} recipients, {what}: {found}", cpu, wall)


def stages(bench: Bench) -> Iterator[Line]:
    """Where the time of `apex` goes, in one process."""
    for name in ("horse-gallop", "elephant-gallop"):
        animation = bench.animation(name, FEW)
        if not bench.allows(animation[0].topology.n_points):
            continue
        marking, looking = stages_of(animation, bench.key)
        yield from _shares(f"{name}, embed {len(animation)} frames", marking)
        yield from _shares(f"{name}, look at one frame", looking)


def _shares(what: str, stages: Stages) -> Iterator[Line]:
    total = sum(stages.seconds.values())
    yield Line(f"{what}: all", total)
    for name, seconds in sorted(stages.seconds.items(), key=lambda item: -item[1]):
        yield Line(f"{what}: {name}, {seconds / total:.0%}", seconds)


def _frames(path: Path) -> str:
    return f"{len(read(path).meshes[0])} frames"


ROWS: dict[str, Callable[[Bench], Iterator[Line]]] = {
    "elephant": elephant,
    "horse": horse,
    "attacked": attacked,
    "unmarked": unmarked,
    "growth": growth,
    "diameters": diameters,
    "memory": memory,
    "recipients": recipients,
    "stages": stages,
}
