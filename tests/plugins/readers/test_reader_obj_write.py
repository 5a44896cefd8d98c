from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from meshmark.errors import OutputError, UsageError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.topology import Topology
from meshmark.testing.attacks import sphere
from meshmark.testing.readers import contents, shifted
from meshmark_plugins.readers.obj import ObjFrames
from meshmark_plugins.readers.obj_write import write_new

# Line ends, spacing, digits and trailing data that a careless writer would lose.
MIXED = b"# x\r\n v 0.500 0 0 1 0 0 # red\nvt 0 1\nv\t1e0 0 0\r\nv 0 1 \\\n 0\ng a\nf 1/1 2/1 -1/1"


def triangle(x: float = 0.0) -> str:
    return f"v {x} 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def write_files(folder: Path, files: dict[str, str | bytes]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return folder


def test_write_keeps_all_bytes_of_unmoved_vertices(tmp_path):
    source = write_files(tmp_path / "in", {"a1.obj": MIXED, "a2.obj": MIXED})
    original = ObjFrames().read(str(source))
    ObjFrames().write(original, original, tmp_path / "out")
    assert [*map(Path.read_bytes, sorted((tmp_path / "out").iterdir()))] == [MIXED, MIXED]
    marked = replace(original, meshes=(original.meshes[0].map(shifted),))
    ObjFrames().write(marked, original, tmp_path / "moved")
    moved = MIXED.replace(b"v 0.500 0 0", b"v 0.501 0.001 0.001").replace(
        b"v 0 1 \\\n 0", b"v 0.001 1.001 \\\n 0.001"
    )
    assert (tmp_path / "moved" / "a2.obj").read_bytes() == moved


def test_frames_that_were_not_marked_are_copied(tmp_path):
    source = write_files(tmp_path / "in", {f"{i}.obj": triangle(i) for i in (1, 2, 3)})
    original = ObjFrames().read(str(source))
    mesh = original.meshes[0]
    marked = replace(original, meshes=(mesh.select([1]).map(shifted),))
    ObjFrames().write(marked, original, tmp_path / "out")
    same = [(tmp_path / "out" / f"{i}.obj").read_text() == triangle(i) for i in (1, 2, 3)]
    assert same == [True, False, True]
    ObjFrames().write(replace(original, meshes=()), original, tmp_path / "untouched")
    assert (tmp_path / "untouched" / "2.obj").read_text() == triangle(2)


def test_writing_refuses_what_it_cannot_do(tmp_path):
    source = write_files(tmp_path / "in", {"1.obj": triangle(), "2.obj": triangle()})
    original = ObjFrames().read(str(source))
    write = ObjFrames().write
    with pytest.raises(OutputError, match="exists already and is not an empty folder"):
        write(original, original, source)
    with pytest.raises(UsageError, match="several OBJ files need a folder"):
        write(original, original, tmp_path / "one.obj")
    with pytest.raises(OutputError, match="cannot be written: No such file"):
        write(original, original, tmp_path / "missing" / "out")
    single = ObjFrames().read(str(source / "1.obj"))
    with pytest.raises(UsageError, match="must not be the source"):
        write(single, single, source / "1.obj")
    later = replace(original, meshes=(replace(original.meshes[0], times=np.array([1.0, 5.0])),))
    with pytest.raises(UsageError, match=r"holds frame 5.0, which the original does not"):
        write(later, original, tmp_path / "out")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in"]


@pytest.mark.filterwarnings("error")
def test_points_that_single_precision_does_not_hold_are_not_written(tmp_path):
    source = write_files(tmp_path / "in", {"1.obj": triangle(), "2.obj": triangle()})
    original = ObjFrames().read(str(source))
    mesh = original.meshes[0].map(lambda frame: frame.moved(frame.points + 1e39))
    far = replace(original, meshes=(mesh,))
    refusal = "frame 1: a point is beyond the range of float32"
    with pytest.raises(OutputError, match=refusal):
        ObjFrames().write(far, original, tmp_path / "out")
    with pytest.raises(OutputError, match=refusal):
        write_new(far, tmp_path / "out")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in"]


def test_a_failure_half_way_leaves_nothing(tmp_path):
    source = write_files(tmp_path / "in", {"1.obj": triangle(), "2.obj": triangle()})
    original = ObjFrames().read(str(source))
    fat = Frame(2.0, np.zeros((4, 3)), Topology.from_triangles(np.array([[0, 1, 2]]), 4))
    wrong = MeshAnimation.from_frames([original.meshes[0][0], fat])
    with pytest.raises(UsageError, match=r"2\.obj: frame 2: the marked copy has 4 vertices"):
        ObjFrames().write(replace(original, meshes=(wrong,)), original, tmp_path / "out")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in"]


def test_an_existing_empty_folder_is_filled(tmp_path):
    source = write_files(tmp_path / "in", {"1.obj": triangle()})
    original = ObjFrames().read(str(source))
    (tmp_path / "out").mkdir()
    ObjFrames().write(original, original, tmp_path / "out")
    assert contents(tmp_path / "out")


@pytest.mark.parametrize(
    ("times", "names"),
    [
        ([1, 3, 12], ["0001", "0003", "0012"]),
        ([9999, 10000], ["09999", "10000"]),
        ([1, 1.5], ["0001.0", "0001.5"]),
        ([-1, 0, 1], ["-0001", "0000", "0001"]),
        ([-1.25, -0.5, 0, 10], ["-0000.50", "-0001.25", "0000.00", "0010.00"]),
        ([1.001, 1.01, 1.1], ["0001.001", "0001.010", "0001.100"]),
        ([1e-30, 1], ["0001", "0002"]),
        ([math.nan], ["0001"]),
    ],
)
def test_new_files_are_named_by_time(tmp_path, times, names):
    V, F = sphere(50)
    topology = Topology.from_triangles(F, 50)
    frames = [Frame(float(t), V + i, topology) for i, t in enumerate(times)]
    asset = Asset("x", (MeshAnimation.from_frames(frames),), "none")
    write_new(asset, tmp_path / "out")
    assert sorted(path.stem for path in (tmp_path / "out").iterdir()) == names
    again = ObjFrames().read(str(tmp_path / "out")).meshes[0]
    if times[0] != 1e-30 and not math.isnan(times[0]):
        assert again.times.tolist() == times
    for before, after in zip(frames, again, strict=True):
        np.testing.assert_allclose(after.points, before.points, atol=1e-6)


def test_new_files_hold_all_meshes_as_objects(tmp_path):
    topology = Topology(np.array([4, 3]), np.array([0, 1, 2, 3, 1, 4, 2]), 5)
    V = np.arange(15.0).reshape(5, 3)
    quad = MeshAnimation.from_frames([Frame(1.0, V, topology)], prim="/A")
    ball = MeshAnimation.from_arrays(*sphere(50), prim="/B")
    write_new(Asset("x", (quad, ball), "none"), tmp_path / "out")
    frame = ObjFrames().read(str(tmp_path / "out")).meshes[0][0]
    assert frame.topology.n_points == 55
    assert frame.topology.counts[:3].tolist() == [4, 3, 3]
    np.testing.assert_array_equal(frame.topology.indices[7:] - 5, ball[0].topology.indices)
    assert b"\no /B\n" in (tmp_path / "out" / "0001.obj").read_bytes()
    later = replace(ball, times=np.array([2.0]))
    with pytest.raises(UsageError, match="/B: its time codes differ"):
        write_new(Asset("x", (quad, later), "none"), tmp_path / "other")
