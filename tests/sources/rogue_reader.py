"""A reader that behaves as a library does on a hostile file; `install` makes a plugin of it."""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

import numpy as np

from meshmark.errors import InputError
from meshmark.extension.hookspecs import ReaderRecord, hookimpl
from meshmark.mesh.animation import Frame, InMemoryFrames, MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.topology import Topology
from meshmark.testing.meshes import icosphere

METADATA = "Metadata-Version: 2.1\nName: rogue\nVersion: 1.0\n"
V, F = icosphere(2)
TOPOLOGY = Topology.from_triangles(F, len(V))


def install(site: Path) -> None:
    """Make a distribution of this module in a folder that is on the import path."""
    (site / "rogue_reader.py").write_text(Path(__file__).read_text("utf-8"), "utf-8")
    described = site / "rogue-1.0.dist-info"
    described.mkdir()
    (described / "METADATA").write_text(METADATA)
    (described / "entry_points.txt").write_text("[meshmark]\nrogue = rogue_reader\n")


class Frames:
    """Frames of which reading one does what the file is called."""

    def __init__(self, deed: str, path: Path) -> None:
        self.deed, self.path = deed, path

    def frame(self, index: int) -> Frame:
        time.sleep(0.25 if self.deed == "slow" else 0.0)
        points = V * (1.0 + index)
        if index == 1:
            self.misbehave()
        return Frame(float(index), points, TOPOLOGY)

    def misbehave(self) -> None:
        # As pxr leaves a report of a crash.
        os.close(tempfile.mkstemp()[0])
        if self.deed == "abort":
            os.abort()
        if self.deed == "hang":
            print("still here", flush=True)
            time.sleep(600)
        if self.deed == "leave":
            os._exit(7)
        if self.deed == "allocate":
            hoard = [np.ones(1 << 24)]
            while True:
                hoard.append(hoard[0] + 1.0)
        if self.deed == "spoilt":
            raise InputError("is spoilt", source=self.path, prim="/", time=1.0)
        if self.deed == "bug":
            raise AssertionError("of its own making")
        if self.deed == "exchange":
            self.path.write_text("another", "utf-8")


class RogueReader:
    """Reads `DEED.rogue`."""

    def accepts(self, source: str) -> bool:
        return source.endswith(".rogue")

    def read(self, source: str) -> Asset:
        path = Path(source)
        frames = Frames(path.stem, path)
        if path.stem == "large":
            big = Frame(0.0, np.zeros((10**6, 3)), Topology(np.array([3]), np.arange(3), 10**6))
            frames = InMemoryFrames((big,) * 20)
        mesh = MeshAnimation(np.arange(20.0), frames, origin=source, notes=("é",))
        return Asset(source, (mesh,), "rogue", "Z", 1.0, float("nan"), ("read by a rogue",))

    def writes(self, output: Path) -> bool:
        return False


@hookimpl
def meshmark_readers():
    yield ReaderRecord("rogue", RogueReader, "Misbehaves.", "1.0", {})
