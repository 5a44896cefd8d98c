"""The benchmark as a whole: mark every asset, run every cell once, gather the report."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from meshmark.benchmarking.marked_copies import (
    MarkedCopy,
    copy_of,
    make_copy,
    make_master,
    make_recipients_copy,
    recipients,
)
from meshmark.benchmarking.report_document import Outcome, document_of
from meshmark.benchmarking.store import FORMAT, Store, code_hash, identity_hash
from meshmark.benchmarking.subjects import Subject, count_distinct, subjects_of
from meshmark.benchmarking.suites import Suite
from meshmark.benchmarking.tasks import (
    SIDES,
    Bench,
    CellTask,
    DistortionTask,
    Order,
    Pairing,
    Task,
    failure,
    perform,
    subject_identity,
)
from meshmark.errors import MeshmarkError, PluginError
from meshmark.extension.recipe import Recipe
from meshmark.extension.registry import RegisteredPlugin, catalogue
from meshmark.keys import Key
from meshmark.version import __version__
from meshmark.workers.ordered_map import ordered_map
from meshmark.workers.progress import MeshProgress, StageProgress


@dataclass(frozen=True)
class Place:
    """The folder of a benchmark: results, marked copies, the public key.

    A second benchmark in the same folder uses what it finds there.
    """

    folder: Path

    @property
    def results(self) -> Path:
        """One JSON file for each finished cell."""
        return self.folder / "cells"

    @property
    def copies(self) -> Path:
        """The marked copies."""
        return self.folder / "marked"

    def key_file(self, seed: int) -> Path:
        """Return the key file by which any cell can be repeated by hand."""
        return self.folder / f"benchmark-{seed}.key"


def benchmark_key(seed: int) -> Key:
    """Derive the key of a seed. It is public: it marks nothing but benchmarks."""
    return Key(hashlib.sha256(f"meshmark public benchmark key {seed}".encode()).digest())


def run_benchmark(
    sources: Sequence[str],
    suite: Suite,
    recipes: Sequence[Recipe],
    folder: Path,
    *,
    informed: bool = False,
    frames: str | None = None,
    seed: int = 0,
    trusted: bool = True,
    jobs: int = 1,
    progress: StageProgress | None = None,
) -> dict[str, Any]:
    """Run a benchmark, or what is missing of it.

    Parameters
    ----------
    sources : sequence of str
        Assets, as `meshmark.read` takes them.
    suite : Suite
        What is done to them.
    recipes : sequence of Recipe
        Schemes, with their parameters: each marks copies of its own; or, with `informed`, the
        layers of one mark.
    folder : Path
        Where results are kept. Those already there are not computed again, so that a run that
        was broken off goes on where it was.
    informed : bool
        Whether copies are verified beside their original, not blindly.
    frames : str, optional
        Range A:B[:S] of time codes; the others are neither marked nor attacked.
    seed : int
        Of the key and of every attack. Two runs differ in their timings only.
    trusted : bool
        Without it, the sources are first read in processes of their own.
    jobs : int
        Processes that work, this one among them.
    progress : callable, optional
        Called with (stage, what, done, in all).

    Returns
    -------
    dict
        The report; its schema is `schemas/json/benchmark.schema.json`. Nothing but results is
        written; see `meshmark.benchmarking.report_tables`.

    Raises
    ------
    InputError
        If a source cannot be read. Whatever goes wrong later is part of the report.
    UsageError
        If no frame lies in the range.
    OutputError
        If the folder cannot be written to.
    """
    start = time.perf_counter()
    subjects = subjects_of(sources, frames, isolated=not trusted)
    place = Place(folder)
    bench = _bench(place, suite, recipes, seed)
    n_copies = 1 + max((cell.others for cell in suite.cells), default=0)
    choices = [tuple(recipes)] if informed else [(recipe,) for recipe in recipes]
    mark = _mark_in_layers if informed else _mark
    pairings = [
        mark(bench, place, Pairing(subject, choice, informed=informed), n_copies, progress, jobs)
        for subject in subjects
        for choice in choices
    ]
    tasks = _tasks(bench, suite, pairings)
    _perform_missing(tasks, jobs, progress)
    return document_of(
        suite=suite,
        recipes=recipes,
        subjects=[(subject, _frame_counts(subject)) for subject in subjects],
        bench=bench,
        outcomes=[_outcome(bench, place, suite, pairing) for pairing in pairings],
        elapsed_s=time.perf_counter() - start,
    )


def _bench(place: Place, suite: Suite, recipes: Sequence[Recipe], seed: int) -> Bench:
    store = Store(place.results)
    Store(place.copies)
    key = benchmark_key(seed)
    if not place.key_file(seed).exists():
        key.save(place.key_file(seed))
    versions = {
        "format": FORMAT,
        "meshmark": __version__,
        "code": code_hash(_offers(suite, recipes)),
    }
    return Bench(store, key, seed, versions)


def _offers(suite: Suite, recipes: Sequence[Recipe]) -> list[RegisteredPlugin]:
    attacks = {cell.attack for cell in suite.cells}
    known = [offer for offer in catalogue().of_kind("attack") if offer.name in attacks]
    return [*known, *(offer for recipe in recipes for offer in recipe.offers)]


def _mark(
    bench: Bench,
    place: Place,
    pairing: Pairing,
    n_copies: int,
    tell: StageProgress | None,
    jobs: int,
) -> Pairing:
    """Mark as many copies as the suite needs: the first is the owner's own."""
    subject, [recipe] = pairing.subject, pairing.layers
    copies: list[MarkedCopy] = []
    for recipient in (None, *recipients(n_copies - 1)):
        make = partial(make_copy, subject, recipe, bench.key, recipient)
        made = _kept(bench, place, pairing, "copy", recipient, make, tell, jobs)
        if isinstance(made, str):
            return replace(pairing, error=made)
        copies.append(made)
    return replace(pairing, copies=tuple(copies))


def _mark_in_layers(
    bench: Bench,
    place: Place,
    pairing: Pairing,
    n_copies: int,
    tell: StageProgress | None,
    jobs: int,
) -> Pairing:
    """Make the master once, and on it as many recipients' copies as the suite needs."""
    subject, layers = pairing.subject, pairing.layers
    make = partial(make_master, subject, layers, bench.key)
    master = _kept(bench, place, pairing, "master", None, make, tell, jobs)
    if isinstance(master, str):
        return replace(pairing, error=master)
    copies: list[MarkedCopy] = []
    for recipient in recipients(n_copies):
        make = partial(make_recipients_copy, subject, layers, bench.key, recipient, master)
        made = _kept(bench, place, pairing, "copy", recipient, make, tell, jobs)
        if isinstance(made, str):
            return replace(pairing, error=made)
        copies.append(made)
    blind = any(not layer.informed for layer in layers)
    return replace(pairing, copies=tuple(copies), master=master if blind else None)


def _kept(
    bench: Bench,
    place: Place,
    pairing: Pairing,
    kind: str,
    recipient: str | None,
    make: Callable[..., dict[str, Any]],
    progress: StageProgress | None,
    jobs: int,
) -> MarkedCopy | str:
    """Find a marked file where an earlier run left it, or make it; the reason if that fails."""
    subject = pairing.subject
    identity = copy_identity(bench, place, pairing, kind, recipient)
    schemes = "-".join(layer.scheme for layer in pairing.layers)
    path = place.copies / f"{Path(subject.asset).stem}-{schemes}-{identity_hash(identity)[:8]}.usdc"
    if not (bench.store.finished(identity) and path.exists()):
        what = f"{subject.asset} {pairing.scheme}"
        tell = None if progress is None else _renamed(progress, what)
        try:
            result = make(path, jobs=jobs, progress=tell)
        except MeshmarkError as error:
            result = failure(error, is_plugin=isinstance(error, PluginError))
        # As for cells: a scheme of somebody else's must not end the run.
        except Exception as error:
            result = failure(error, is_plugin=True)
        bench.store.save(identity, result)
    described = bench.store.load(identity) or {}
    if "error" in described:
        return str(described["error"])
    return copy_of(path, subject.frames, described)


def _renamed(progress: StageProgress, what: str) -> MeshProgress:
    return lambda prim, done, total: progress("mark", f"{what} {prim}", done, total)


def copy_identity(
    bench: Bench, place: Place, pairing: Pairing, kind: str, recipient: str | None
) -> dict[str, Any]:
    """Tell what determines a marked copy, or a master."""
    subject = pairing.subject
    source, folder = Path(subject.source).resolve(), place.copies.resolve()
    return {
        "kind": kind,
        # A layer over its source finds it by its place.
        "source": Path(os.path.relpath(source, folder)).as_posix(),
        **subject_identity(bench, subject),
        **pairing.identity,
        "recipient": recipient,
    }


def _tasks(bench: Bench, suite: Suite, pairings: Sequence[Pairing]) -> list[Task]:
    """List the work, the longest pieces first."""
    able = [pairing for pairing in pairings if pairing.error is None]
    distortions: list[Task] = [DistortionTask(bench, pairing) for pairing in able]
    cells: list[Task] = [
        CellTask(bench, pairing, cell, side)
        for pairing in able
        for cell in suite.cells
        for side in SIDES
    ]
    return [*distortions, *cells]


def _perform_missing(tasks: Sequence[Task], jobs: int, progress: StageProgress | None) -> None:
    orders = [Order(task, task.identity) for task in tasks]
    missing = {
        identity_hash(order.identity): order
        for order in orders
        if not order.task.bench.store.finished(order.identity)
    }
    done = len(tasks) - len(missing)
    if progress is not None:
        progress("bench", "cells", done, len(tasks))
    for _ in ordered_map(perform, list(missing.values()), jobs=jobs):
        done += 1
        if progress is not None:
            progress("bench", "cells", done, len(tasks))


def _frame_counts(subject: Subject) -> tuple[int, int]:
    """Count frames, and those that repeat no earlier one, of the mesh with the most frames."""
    mesh = max(subject.load().meshes, key=len)
    return len(mesh), count_distinct(mesh)


def _outcome(bench: Bench, place: Place, suite: Suite, pairing: Pairing) -> Outcome:
    kind = "master" if pairing.informed else "copy"
    copy = bench.store.load(copy_identity(bench, place, pairing, kind, None)) or {}
    if pairing.error is not None:
        failed = {**copy, "error": pairing.error}
        return Outcome(pairing, failed, failed, tuple((failed, failed) for _ in suite.cells))
    results = tuple(
        (
            _result_of(CellTask(bench, pairing, cell, "marked")),
            _result_of(CellTask(bench, pairing, cell, "control")),
        )
        for cell in suite.cells
    )
    return Outcome(pairing, copy, _result_of(DistortionTask(bench, pairing)), results)


def _result_of(task: Task) -> dict[str, Any]:
    found = task.bench.store.load(task.identity)
    return {"error": "its result is gone from the folder"} if found is None else found
