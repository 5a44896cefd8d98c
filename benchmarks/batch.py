"""Verifies many suspects: by a command that is killed half way, on a cluster that loses a worker.

    python benchmarks/batch.py [--suspects 1000] [--marked 50] [--broken 10] [--scheme apex relief]
        [--of creature cow horse] [VERIFY OPTIONS...]

Suspects are single frames of some animations, as USD, glTF and OBJ, moved and roughened: some of
the first one marked for a recipient each, some broken, all others unmarked. Schemes that need an
original get the first one's. Prints what docs/batch.md tells.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
from fast_simplification import simplify

import meshmark
from measuring import data_folder
from meshmark.commands.attack import write_attacked
from meshmark.demo import creature
from meshmark.extension.defaults import DEFAULT_LAYERS
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset

SUFFIXES = (".usdc", ".glb", "")
ORIGINAL = "original.usdc"
POINTS = 1500
ANIMATIONS = {"cow": "pcow.usdc", "horse": "horse-gallop.usdc"}
STRANGERS = 50
WATCH_EVERY = 1.0  # seconds


@dataclass(frozen=True)
class Suspects:
    """A folder of suspects, and what is to be found in it."""

    folder: Path
    named: dict[str, str]
    broken: frozenset[str]
    total: int


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--suspects", type=int, default=1000)
    parser.add_argument("--marked", type=int, default=50)
    parser.add_argument("--broken", type=int, default=10)
    parser.add_argument("--scheme", nargs="+", default=list(DEFAULT_LAYERS))
    parser.add_argument("--of", nargs="+", choices=["creature", *ANIMATIONS], default=["creature"])
    arguments, more = parser.parse_known_args()
    layers = [Recipe(scheme) for scheme in arguments.scheme]
    work = Path(tempfile.mkdtemp(prefix="meshmark-bench-"))
    try:
        bases = [still_frame(name) for name in arguments.of]
        made = make(work, bases, arguments.suspects, arguments.marked, arguments.broken, layers)
        verify = ["verify", "suspects", "--key", "k", "--recipient", "@names.txt", *more]
        verify += [word for scheme in arguments.scheme for word in ("--scheme", scheme)]
        if any(layer.informed for layer in layers):
            verify += ["--original", ORIGINAL]
        print(json.dumps({"processes": killed_and_resumed(work, made, verify)}), flush=True)
        print(json.dumps({"cluster": on_a_cluster(work, made, verify)}), flush=True)
    finally:
        shutil.rmtree(work)


def make(
    work: Path,
    bases: Sequence[Asset],
    total: int,
    n_marked: int,
    n_broken: int,
    layers: Sequence[Recipe],
) -> Suspects:
    """Write the suspects, the original, a key and the names to try."""
    key = Key(bytes(range(32)))
    key.save(work / "k")
    names = [f"vendor {i}" for i in range(n_marked)]
    strangers = [f"stranger {i}" for i in range(STRANGERS)]
    (work / "names.txt").write_text("\n".join([*names, *strangers]))
    folder = work / "suspects"
    folder.mkdir()
    rng = np.random.default_rng(1)
    write_attacked(bases[0], work / ORIGINAL)
    named: dict[str, str] = {}
    broken: set[str] = set()
    for place, number in enumerate(rng.permutation(total)):
        path = folder / f"{number:04d}{SUFFIXES[number % len(SUFFIXES)]}"
        base = bases[place % len(bases)]
        if place < n_marked:
            base = meshmark.embed(bases[0], key, recipe=layers, recipient=names[place]).asset
            named[str(path.relative_to(work))] = names[place]
        write_attacked(disguised(base, rng), path)
        if n_marked <= place < n_marked + n_broken:
            break_file(path, place)
            broken.add(str(path.relative_to(work)))
    return Suspects(folder, named, frozenset(broken), total)


def still_frame(name: str) -> Asset:
    """Return one frame of an animation, with few points."""
    if name == "creature":
        animation = creature(points=3000, frames=17)
    else:
        animation = meshmark.read(data_folder() / ANIMATIONS[name]).meshes[0]
    frame = animation[0]
    V, F = frame.points.astype(np.float32), frame.topology.triangles.astype(np.int32)
    V, F = simplify(V, F, 1.0 - POINTS / len(V))
    mesh = MeshAnimation.from_arrays(V.astype(np.float64), F, prim="/Mesh")
    return Asset("memory", (mesh,), "memory")


def disguised(asset: Asset, rng: np.random.Generator) -> Asset:
    """Turn, scale and roughen an asset."""
    frame = asset.meshes[0][0]
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    V = frame.points @ turn * rng.uniform(0.5, 2.0)
    V = V + rng.normal(scale=1e-4 * np.ptp(V), size=V.shape)
    mesh = MeshAnimation.from_arrays(V, frame.topology.triangles, prim="/Mesh")
    return Asset("memory", (mesh,), "memory")


def break_file(path: Path, place: int) -> None:
    """Cut a file short, or let there be something else."""
    file = path if path.is_file() else next(path.iterdir())
    data = file.read_bytes()
    file.write_bytes(
        data[: len(data) // 3] if place % 2 and path.is_file() else b"no mesh %d" % place
    )


def killed_and_resumed(work: Path, made: Suspects, verify: list[str]) -> dict[str, object]:
    """Kill the command half way, and resume it."""
    answers = work / "answers.jsonl"
    words = [*verify, "--resume", answers.name, "--jobs", "2"]
    with watched() as most:
        start = time.perf_counter()
        process = started(work, words)
        wait_for(answers, made.total // 2, process)
        process.kill()
        process.wait()
        first = time.perf_counter() - start
        before = len(answers.read_bytes().split(b"\n")) - 1
        start, cpu = time.perf_counter(), cpu_of_children()
        code = started(work, words).wait()
        second = time.perf_counter() - start
    return {
        **judged(answers, made),
        "exit_code": code,
        "answers_when_killed": before,
        "files_a_minute": round(60.0 * made.total / (first + second), 1),
        "cpu_s_a_file": round((cpu_of_children() - cpu) / (made.total - before), 2),
        "peak_gb_of_all_processes": round(max(most) / 1e9, 2),
    }


def on_a_cluster(work: Path, made: Suspects, verify: list[str]) -> dict[str, object]:
    """Kill one of two workers half way."""
    from distributed import LocalCluster

    answers = work / "cluster.jsonl"
    with (
        watched() as most,
        LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            silence_logs=logging.CRITICAL,
        ) as cluster,
    ):
        start = time.perf_counter()
        words = [*verify, "--resume", answers.name, "--scheduler", cluster.scheduler_address]
        process = started(work, words)
        wait_for(answers, made.total // 2, process)
        os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
        code = process.wait()
        seconds = time.perf_counter() - start
    return {
        **judged(answers, made),
        "exit_code": code,
        "files_a_minute": round(60.0 * made.total / seconds, 1),
        "peak_gb_of_all_processes": round(max(most) / 1e9, 2),
    }


def judged(answers: Path, made: Suspects) -> dict[str, int]:
    """Compare answers with what is in the suspects."""
    lines = [json.loads(line) for line in answers.read_text().splitlines()]
    marked = {line["source"]: line["recipient"] for line in lines if line.get("recipient")}
    failed = {line["source"] for line in lines if "error" in line}
    return {
        "answers": len(lines),
        "sources_answered": len({line["source"] for line in lines}),
        "named_rightly": sum(made.named.get(source) == name for source, name in marked.items()),
        "named_wrongly": sum(made.named.get(source) != name for source, name in marked.items()),
        "broken_told": len(failed & made.broken),
        "others_failed": len(failed - made.broken),
    }


def started(work: Path, words: list[str]) -> subprocess.Popen[bytes]:
    # A busy machine is no reason to give up reading.
    environment = {"MESHMARK_READ_SECONDS": "600", **os.environ}
    with (work / "messages").open("ab") as messages:
        return subprocess.Popen(
            [sys.executable, "-m", "meshmark", *words], cwd=work, stderr=messages, env=environment
        )


def wait_for(answers: Path, lines: int, process: subprocess.Popen[bytes]) -> None:
    while not answers.exists() or answers.read_bytes().count(b"\n") < lines:
        time.sleep(0.2)
        if process.poll() is not None:
            sys.exit(f"the command ended with {process.returncode} before it was to be killed")


def cpu_of_children() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


@contextmanager
def watched() -> Iterator[list[int]]:
    """Watch the memory of all processes below this one, shared pages counted once, in bytes."""
    most = [0]
    ended = threading.Event()

    def watch() -> None:
        while not ended.wait(WATCH_EVERY):
            total = 0
            for process in psutil.Process().children(recursive=True):
                try:
                    total += process.memory_full_info().pss
                except psutil.Error:
                    continue
            most.append(total)

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        yield most
    finally:
        ended.set()
        thread.join()


if __name__ == "__main__":
    main()
