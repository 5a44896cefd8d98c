"""New stages out: they read back as what was written, in little memory."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from meshmark.errors import OutputError
from meshmark.mesh.animation import Frame, InMemoryFrames, MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.topology import Topology
from meshmark.usd.reading import read_stage
from meshmark.usd.stages import write_stage
from usd_stages import CUBE_COUNTS, CUBE_INDICES, CUBE_POINTS, infinite


def animation(n_frames: int, *, varying: bool = False, prim: str = "/") -> MeshAnimation:
    cube_faces = Topology(np.array(CUBE_COUNTS), np.array(CUBE_INDICES), 8)
    open_box = Topology(np.array(CUBE_COUNTS[:5]), np.array(CUBE_INDICES[:20]), 8)
    frames = [
        Frame(1.0 + k, CUBE_POINTS + k, open_box if varying and k % 2 else cube_faces)
        for k in range(n_frames)
    ]
    return MeshAnimation.from_frames(frames, prim=prim)


@pytest.mark.parametrize("varying", [False, True])
@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
def test_new_stage_reads_back(tmp_path: Path, varying: bool, suffix: str) -> None:
    meshes = (animation(3, varying=varying, prim="/a/b"), animation(2, prim="/a/c"))
    asset = Asset("x", meshes, "test", up_axis="Z", meters_per_unit=1.0, fps=30.0)
    output = tmp_path / f"new{suffix}"
    write_stage(asset, output)
    again = read_stage(str(output))
    assert (again.up_axis, again.meters_per_unit, again.fps) == ("Z", 1.0, 30.0)
    assert [mesh.prim for mesh in again.meshes] == ["/a/b", "/a/c"]
    assert again.meshes[0].constant_topology is not varying
    for mesh, read in zip(meshes, again.meshes, strict=True):
        for before, after in zip(mesh, read, strict=True):
            assert before.time == after.time
            assert before.topology.same_as(after.topology)
            np.testing.assert_array_equal(before.points, after.points)
    stage = Usd.Stage.Open(str(output))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1, 3)
    assert stage.GetDefaultPrim().GetPath() == "/a"
    assert stage.GetPrimAtPath("/a").GetTypeName() == "Xform"
    mesh = UsdGeom.Mesh.Get(stage, "/a/b")
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
    np.testing.assert_array_equal(mesh.GetExtentAttr().Get(2), [[1, 1, 1], [2, 2, 2]])


def test_names_usd_does_not_allow(tmp_path: Path) -> None:
    frame = animation(1)[0]
    still = InMemoryFrames((replace(frame, time=np.nan),))
    prims = ("/", "/node 1/mesh", "/node-1/mesh", "/node 1")
    meshes = tuple(MeshAnimation(np.array([np.nan]), still, prim=prim) for prim in prims)
    write_stage(Asset("x", meshes, "test"), tmp_path / "o.usda")
    again = read_stage(str(tmp_path / "o.usda"))
    found = {mesh.prim for mesh in again.meshes}
    assert found == {"/Mesh", "/node_1", "/node_1/mesh", "/node_1/mesh_2"}
    assert np.isnan(again.meshes[0].times).all()


def test_new_stage_of_bad_points(tmp_path: Path) -> None:
    mesh = animation(3).map(infinite)
    with pytest.raises(OutputError, match="frame 2: a point is not finite"):
        write_stage(Asset("x", (mesh,), "test"), tmp_path / "o.usda")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.filterwarnings("error")
def test_new_stage_of_points_that_single_precision_does_not_hold(tmp_path: Path) -> None:
    mesh = animation(3).map(lambda frame: frame.moved(frame.points + np.float64(1e39)))
    with pytest.raises(OutputError, match="frame 1: a point is beyond the range of float32"):
        write_stage(Asset("x", (mesh,), "test"), tmp_path / "o.usda")
    assert list(tmp_path.iterdir()) == []


class ManyFrames:
    """Frames made when asked for, and the most memory of its own the process had meanwhile."""

    def __init__(self, n_points: int) -> None:
        faces = np.array([[0, 1, 2]])
        self.topology = Topology.from_triangles(faces, n_points)
        self.peak = 0

    def frame(self, index: int) -> Frame:
        status = Path("/proc/self/status").read_text()
        (line,) = (line for line in status.splitlines() if line.startswith("RssAnon"))
        self.peak = max(self.peak, 1024 * int(line.split()[1]))
        points = np.random.default_rng(index).normal(size=(self.topology.n_points, 3))
        return Frame(1.0 + index, points, self.topology)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs /proc")
def test_memory_does_not_grow_with_the_frames(tmp_path: Path) -> None:
    peaks = []
    for n_frames in (10, 130):
        frames = ManyFrames(40_000)
        mesh = MeshAnimation(np.arange(1.0, n_frames + 1), frames)
        write_stage(Asset("x", (mesh,), "test"), tmp_path / f"{n_frames}.usdc")
        peaks.append(frames.peak)
    # 120 frames more are 58 MB more; what is not yet saved is at most 4.
    assert peaks[1] - peaks[0] < 12e6
