"""Pieces of work that processes share out among themselves; each leaves one result on disk."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from meshmark.benchmarking.cells import measure_distortion, run_cell
from meshmark.benchmarking.informed_cells import run_informed_cell
from meshmark.benchmarking.marked_copies import MarkedCopy
from meshmark.benchmarking.store import Store, identity_hash
from meshmark.benchmarking.subjects import Subject
from meshmark.benchmarking.suite_rows import Cell
from meshmark.errors import MeshmarkError, PluginError
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key

Side = Literal["marked", "control"]
SIDES: tuple[Side, ...] = ("marked", "control")

_SEED_BYTES = 4


@dataclass(frozen=True, eq=False)
class Bench:
    """What all pieces of work of one benchmark have in common.

    Parameters
    ----------
    store : Store
        Where results go.
    key : Key
        The benchmark's public key.
    seed : int
        Of everything random.
    versions : mapping
        Version of the format, of meshmark and of the code: part of every result's identity.
    """

    store: Store
    key: Key
    seed: int
    versions: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Pairing:
    """An asset and the layers of a mark, with the copies marked by them.

    Parameters
    ----------
    layers : tuple of Recipe
        One scheme; or those that are laid upon each other, where copies are read beside the
        original.
    copies : tuple of MarkedCopy
        As many as an attack needs; none if the asset cannot be marked.
    error : str or None
        Why it cannot.
    informed : bool
        Whether copies are read beside the original.
    master : MarkedCopy or None
        The asset as the blind layers left it.
    """

    subject: Subject
    layers: tuple[Recipe, ...]
    copies: tuple[MarkedCopy, ...] = ()
    error: str | None = None
    informed: bool = False
    master: MarkedCopy | None = None

    @property
    def scheme(self) -> str:
        """Names of the layers."""
        return " + ".join(layer.scheme for layer in self.layers)

    @property
    def identity(self) -> dict[str, Any]:
        """What determines how copies are marked and read."""
        return {
            "layers": [layer.as_json() for layer in self.layers],
            "informed": self.informed,
        }


def subject_identity(bench: Bench, subject: Subject) -> dict[str, Any]:
    """Tell what determines any result on an asset."""
    return {
        **bench.versions,
        "seed": bench.seed,
        "files": [digest for _, digest in subject.files],
        "frames": subject.frames,
    }


def cell_seed(bench: Bench, subject: Subject, cell: Cell) -> int:
    """Derive the seed of an attack: the same for every scheme, and for the control.

    It depends on what is attacked and how, not on where in a suite the cell stands.
    """
    digests = [digest for _, digest in subject.files]
    parts = [bench.seed, digests, cell.attack, dict(cell.parameters), cell.frames]
    digest = hashlib.sha256(identity_hash({"cell": parts}).encode()).digest()
    return int.from_bytes(digest[:_SEED_BYTES], "big")


@dataclass(frozen=True, eq=False)
class CellTask:
    """One cell on one side: the marked copy, or the unmarked asset."""

    bench: Bench
    pairing: Pairing
    cell: Cell
    side: Side

    @property
    def identity(self) -> dict[str, Any]:
        """Everything that determines the result."""
        cell = self.cell
        return {
            "kind": "cell",
            **subject_identity(self.bench, self.pairing.subject),
            **self.pairing.identity,
            "side": self.side,
            "attack": cell.attack,
            "parameters": dict(cell.parameters),
            "frames_attacked": cell.frames,
            "others": cell.others,
        }

    def work(self) -> dict[str, Any]:
        """Attack and verify."""
        pairing, cell = self.pairing, self.cell
        seed = cell_seed(self.bench, pairing.subject, cell)
        copies: Sequence[Subject | MarkedCopy] = (pairing.subject,) * (1 + cell.others)
        if self.side == "marked":
            copies = pairing.copies[: 1 + cell.others]
        if pairing.informed:
            return run_informed_cell(
                cell,
                seed,
                pairing.layers,
                self.bench.key,
                copies,
                original=pairing.subject,
                master=pairing.master,
            )
        return run_cell(cell, seed, pairing.layers[0], self.bench.key, copies)


@dataclass(frozen=True, eq=False)
class DistortionTask:
    """The distortion of one marked copy."""

    bench: Bench
    pairing: Pairing

    @property
    def identity(self) -> dict[str, Any]:
        """Everything that determines the result."""
        return {
            "kind": "distortion",
            **subject_identity(self.bench, self.pairing.subject),
            **self.pairing.identity,
        }

    def work(self) -> dict[str, Any]:
        """Measure it."""
        return measure_distortion(self.pairing.subject, self.pairing.copies[0])


Task = CellTask | DistortionTask


@dataclass(frozen=True, eq=False)
class Order:
    """A piece of work, and the identity that its result is asked for by.

    The identity is told, not found out anew, by whoever does the work: a worker process loads
    code and plugins by itself, and what it would call the result is not for it to say.
    """

    task: Task
    identity: Mapping[str, Any]


def perform(order: Order) -> None:
    """Do a piece of work and store its result, or why there is none."""
    task = order.task
    try:
        result = task.work()
    except MeshmarkError as error:
        result = failure(error, is_plugin=isinstance(error, PluginError))
    # Schemes, solvers and attacks are anybody's code, and what is left of an attacked mesh may
    # be stranger than its author thought of: one cell less, not the end of the run.
    except Exception as error:
        result = failure(error, is_plugin=True)
    task.bench.store.save(order.identity, result)


def failure(error: Exception, *, is_plugin: bool) -> dict[str, Any]:
    """Put an error into JSON values, without the folders of this machine."""
    text = error.message if isinstance(error, MeshmarkError) else f"{type(error).__name__}: {error}"
    where = ""
    if isinstance(error, MeshmarkError):
        time = "" if error.time is None or error.time != error.time else f"frame {error.time:g}"
        where = ": ".join(part for part in (error.prim or "", time) if part)
    message = " ".join(f"{where}: {text}".split()) if where else " ".join(text.split())
    return {"error": message, "plugin": is_plugin}
