from __future__ import annotations

import math
import os
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from meshmark.errors import InputError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.testing.attacks import bending_ball, sphere
from meshmark.testing.readers import ReaderSuite
from meshmark_plugins.readers import RECORDS
from meshmark_plugins.readers.obj import ObjFrames
from meshmark_plugins.readers.obj_text import ObjText
from meshmark_plugins.readers.obj_write import write_new

RECORD = {record.name: record for record in RECORDS}["obj"]

# One of everything: comments, indents, tabs, continuation, colours, groups, n-gons, CRLF,
# texture and normal indices, relative indices, and a comment that ends in a backslash.
WEIRD = (
    b"\xef\xbb\xbf# made by hand, f 1 2 3\r\nmtllib scene.mtl\r\n# C:\\scenes\\\r\n"
    b"o quad\r\n  v 0 0 0 1.0 # a w\r\nv\t1 \\\r\n 0 0\r\nvt 0 0\r\nvn 0 0 1\r\n"
    b"v 1 1 0 0.5 0.25 0.125\r\nv 0 1 0\r\ns off\r\nf -4/1 -3/1 -2 -1//1\r\n"
    b"o triangle\r\nv 2.50 0 -1e-3\r\nusemtl red\r\nf 2 5 3 # tail\r\nl 1 2\r\n"
)


def triangle(x: float = 0.0) -> str:
    return f"v {x} 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def write_files(folder: Path, files: dict[str, str | bytes]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return folder


class TestObjFolder(ReaderSuite):
    @pytest.fixture
    def record(self):
        return RECORD

    @pytest.fixture
    def source(self, tmp_path):
        asset = Asset(source="ball", meshes=(bending_ball(),), reader="none")
        write_new(asset, tmp_path / "ball")
        return str(tmp_path / "ball")

    @pytest.fixture
    def broken_source(self, tmp_path):
        return str(write_files(tmp_path / "broken", {"a.obj": "PNG\x1a of some kind"}))

    @pytest.fixture
    def output(self, tmp_path):
        place = tmp_path / "out"
        place.mkdir()
        return place / "marked"


class TestSingleObj(TestObjFolder):
    @pytest.fixture
    def source(self, tmp_path):
        return str(write_files(tmp_path, {"weird.obj": WEIRD}) / "weird.obj")

    @pytest.fixture
    def broken_source(self, tmp_path):
        return str(write_files(tmp_path, {"broken.obj": b"\0\1\2"}) / "broken.obj")

    @pytest.fixture
    def output(self, tmp_path):
        place = tmp_path / "out"
        place.mkdir()
        return place / "marked.obj"


class TestObjPatternOfVaryingTopology(TestObjFolder):
    @pytest.fixture
    def source(self, tmp_path):
        quad = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"
        write_files(tmp_path / "mixed", {"f2.obj": triangle(), "f10.obj": quad, "f3.obj": WEIRD})
        return str(tmp_path / "mixed" / "f*.obj")


def test_every_way_to_write_a_mesh_is_understood():
    text = ObjText(WEIRD)
    V = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2.5, 0, -1e-3]]
    np.testing.assert_array_equal(text.points(), V)
    assert text.topology().counts.tolist() == [4, 3]
    assert text.topology().indices.tolist() == [0, 1, 2, 3, 1, 4, 2]


def test_only_the_changed_coordinates_are_written_anew():
    text = ObjText(WEIRD)
    V = text.points()
    assert text.with_points(V) is WEIRD
    V[1, 0], V[2, 2], V[4, 0] = 1 / 3, -1e-7, 2.5
    wanted = WEIRD.replace(b"v\t1 \\\r\n", b"v\t0.33333334 \\\r\n")
    wanted = wanted.replace(b"v 1 1 0 0.5", b"v 1 1 -1e-07 0.5")
    assert text.with_points(V) == wanted


def test_written_digits_are_enough_for_float32(tmp_path):
    rng = np.random.default_rng(0)
    V = rng.normal(size=(500, 3)) * 10.0 ** rng.integers(-12, 12, size=(500, 3))
    _, F = sphere(500)
    still = Asset("x", (MeshAnimation.from_arrays(np.ones((500, 3)), F),), "none")
    write_new(still, tmp_path / "x.obj")
    text = ObjText((tmp_path / "x.obj").read_bytes())
    again = ObjText(text.with_points(V)).points()
    np.testing.assert_array_equal(again.astype(np.float32), V.astype(np.float32))


@pytest.mark.parametrize(
    ("names", "times"),
    [
        (["0001", "0003", "0012"], [1, 3, 12]),
        (["f2", "f10", "f1"], [1, 2, 10]),
        (["horse.0007", "horse.0008"], [7, 8]),
        (["cow", "horse"], [1, 2]),
        (["a3", "b3"], [1, 2]),
        (["a.obj", "a2"], [1, 2]),
        (["anim.-3", "anim.-1", "anim.0", "anim.2", "anim.10"], [-3, -1, 0, 2, 10]),
        (["-2", "-10", "3"], [-10, -2, 3]),
        (["anim-1", "anim-2", "anim-10"], [1, 2, 10]),
        (["anim_-0.5", "anim_0", "anim_0.25"], [-0.5, 0, 0.25]),
        (["anim.1.0", "anim.1.25", "anim.1.5", "anim.2.0"], [1, 1.25, 1.5, 2]),
        (["1.5", "1.25"], [1.25, 1.5]),
        (["shot.12.0001", "shot.12.0002", "shot.12.0010"], [1, 2, 10]),
        (["v2.9", "v2.10"], [9, 10]),
    ],
)
def test_names_give_order_and_times(tmp_path, names, times):
    for name in names:
        write_files(tmp_path, {f"{name}.obj": triangle()})
    (tmp_path / "notes.txt").write_text("not a frame")
    assert ObjFrames().read(str(tmp_path)).meshes[0].times.tolist() == times


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["body_1", "body_2", "lod_1", "lod_2"], r"body_\[-0-9\]\*\.obj \(2\), lod_"),
        (["body_1", "body_2", "body"], r"body_\[-0-9\]\*\.obj \(2\), body\.obj \(1\)"),
        (["a.1.5", "a.2", "b.1.5"], r"a\.\[-0-9\]\*\.obj \(2\), b\."),
        (["walk1x", "walk2x", "cow", "horse"], r"walk\[-0-9\]\*x\.obj \(2\), cow"),
        (["body_1", "body_01", "body_2"], r"body_0?1\.obj and body_0?1\.obj are the same frame"),
        (["walk1x", "walk01x"], "are the same frame"),
        (["a.1.1", "a.1.25", "a.1.5"], "may be 1 to 25 or 1.1 to 1.25, in another order"),
    ],
)
def test_what_is_no_sequence_is_refused_by_name(tmp_path, names, words):
    write_files(tmp_path / "f2", {f"{name}.obj": triangle() for name in names})
    for source in (tmp_path / "f2", tmp_path / "f2" / "*.obj"):
        with pytest.raises(InputError, match=words) as caught:
            ObjFrames().read(str(source))
        assert caught.value.source == str(source)
        for pattern in re.findall("as in '(.*)'", caught.value.message):
            frames = ObjFrames().read(pattern).meshes[0]
            assert len(frames) == sum(name.startswith(names[0][:2]) for name in names[:2])


def test_a_folder_for_each_frame_is_in_natural_order(tmp_path):
    for i in (1, 2, 10):
        write_files(tmp_path / f"f{i}", {"mesh.obj": triangle(i)})
    mesh = ObjFrames().read(str(tmp_path / "*" / "mesh.obj")).meshes[0]
    assert [frame.points[0, 0] for frame in mesh] == [1, 2, 10]
    write_files(tmp_path / "g1", {"mesh.obj": triangle(1)})
    with pytest.raises(InputError, match="more than one sequence"):
        ObjFrames().read(str(tmp_path / "*" / "mesh.obj"))


def test_natural_order_is_kept_in_the_frames(tmp_path):
    write_files(tmp_path, {f"walk{i}x.obj": triangle(i) for i in (1, 2, 10)})
    mesh = ObjFrames().read(str(tmp_path)).meshes[0]
    assert [frame.points[0, 0] for frame in mesh] == [1, 2, 10]
    assert mesh.times.tolist() == [1, 2, 3]


def test_a_single_file_has_no_time(tmp_path):
    source = write_files(tmp_path, {"v2.obj": triangle()}) / "v2.obj"
    mesh = ObjFrames().read(str(source)).meshes[0]
    assert len(mesh) == 1
    assert math.isnan(mesh.times[0])


def test_topology_is_recognised_however_it_is_written(tmp_path):
    relative = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf -3/1 -2/1 -1/1\n"
    write_files(tmp_path / "same", {"1.obj": triangle(), "2.obj": relative})
    turned = triangle().replace("1 2 3", "2 3 1")
    write_files(tmp_path / "turned", {"1.obj": triangle(), "2.obj": turned})
    # Equal face lines, but one vertex more in between: other vertices are meant.
    longer = "v 9 9 9\n" + relative
    write_files(tmp_path / "longer", {"1.obj": relative, "2.obj": longer})
    constant = {
        name: ObjFrames().read(str(tmp_path / name)).meshes[0].constant_topology
        for name in ("same", "turned", "longer")
    }
    assert constant == {"same": True, "turned": False, "longer": False}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3", "line 2: a coordinate is not finite"),
        ("v 0 0 0\nv 1 1e999 0\nv 0 1 0\nf 1 2 3", "line 2: a coordinate is not finite"),
        ("v 0 0 0\nv 1 0\nv 0 1 0\nf 1 2 3", "line 2: a vertex needs three coordinates"),
        ("v 0 0 0\nv 1 zero 0\nv 0 1 0\nf 1 2 3", "line 2: 'zero' is not a coordinate"),
        ("# \\\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4", "line 5: face index 4 is out of range"),
        ("v 0 0 0\nv 1 0 0\nf 1 0 2", "line 3: face index 0 is out of range"),
        ("v 0 0 0\nf -1 -1 -2", "line 2: face index -2 is out of range for 1 vertices"),
        ("v 0 0 0\nf 1 1.5 1", "line 2: '1.5' is not a face index"),
        ("v 0 0 0\nf 1 1", "line 2: a face needs three corners"),
        ("v 0 0 0\n", "no faces"),
        ("f 1 2 3\n", "no vertices"),
        ("", "no vertices"),
        (b"\x89PNG\0\0", "not a text file"),
    ],
)
def test_what_is_wrong_is_said_with_file_and_line(tmp_path, content, words):
    write_files(tmp_path, {"f1.obj": triangle(), "f7.obj": content})
    with pytest.raises(InputError, match=words) as caught:
        list(ObjFrames().read(str(tmp_path)).meshes[0])
    assert caught.value.source == str(tmp_path / "f7.obj")
    assert caught.value.time == 7


def test_places_without_frames_are_refused(tmp_path):
    with pytest.raises(InputError, match="nowhere: no such file or folder"):
        ObjFrames().read(str(tmp_path / "nowhere"))
    with pytest.raises(InputError, match=r"there is no \.obj file"):
        ObjFrames().read(str(tmp_path))
    with pytest.raises(InputError, match=r"\*\.obj: there is no \.obj file"):
        ObjFrames().read(str(tmp_path / "*.obj"))
    assert not ObjFrames().accepts(str(tmp_path))


def test_a_file_that_changed_after_reading_is_noticed(tmp_path):
    write_files(tmp_path, {"1.obj": triangle(), "2.obj": triangle()})
    mesh = ObjFrames().read(str(tmp_path)).meshes[0]
    write_files(tmp_path, {"2.obj": "v 9 9 9\n" + triangle()})
    with pytest.raises(InputError, match=r"2\.obj: frame 2: 4 vertices where there were 3"):
        mesh[1]


def calls_to_parse(V, F) -> int:
    """Parse a frame as it should be, and count the calls of Python and C functions."""
    text = ("v %r %r %r\n" * len(V)) % tuple(V.ravel().tolist())
    text += ("f %d/%d %d/%d %d/%d\n" * len(F)) % tuple(np.repeat(F, 2, axis=1).ravel().tolist())
    calls = 0

    def count(frame, event, argument):
        nonlocal calls
        calls += event.endswith("call")

    sys.setprofile(count)
    try:
        parsed = ObjText(text.encode())
        points, counts = parsed.points(), parsed.topology().counts
    finally:
        sys.setprofile(None)
    np.testing.assert_array_equal(points, V)
    np.testing.assert_array_equal(counts, np.full(len(F), 3))
    return calls


def test_a_large_frame_takes_no_more_calls_than_a_small_one():
    rng = np.random.default_rng(0)
    V, F = rng.normal(size=(42_000, 3)), rng.integers(1, 43, size=(84_000, 3))
    assert calls_to_parse(V, F) <= calls_to_parse(V[:42], F[:84]) + 10


def test_the_horse_equals_its_stage(data_folder):
    from pxr import Usd, UsdGeom

    mesh = ObjFrames().read(str(data_folder / "horse-gallop-obj")).meshes[0]
    assert mesh.times.tolist() == list(range(1, 24, 2))
    assert mesh.constant_topology
    assert mesh[0].points.shape == (8431, 3)
    assert mesh[0].faces.shape == (16843, 3)
    stage = Usd.Stage.Open(os.fspath(data_folder / "horse-gallop.usdc"))
    geometry = UsdGeom.Mesh(stage.GetPrimAtPath("/Horse/Geom/body"))
    F = np.array(geometry.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
    np.testing.assert_array_equal(mesh[0].faces, F)
    for frame in mesh:
        points = np.array(geometry.GetPointsAttr().Get(frame.time), dtype=np.float32)
        np.testing.assert_array_equal(frame.points.astype(np.float32), points)


@pytest.mark.parametrize(
    ("line", "word"),
    [
        ("f 1 2 /3", "/3"),
        ("f 1 2 3 /", "/"),
        ("f / / /", "/"),
        ("f /1 /2 /3", "/1"),
        ("f 1/2 2 //3", "//3"),
        ("f 1 2 x/3", "x/3"),
        ("f 1 2 1_0", "1_0"),
        ("f 1 2 3.0", "3.0"),
        ("f 1 2 + 3", "+"),
        ("f 1 2 3 1-2", "1-2"),
        ("v 1 2 3 1-2", "1-2"),
        ("v 1 2 1_0", "1_0"),
        ("v 1 2 0x10", "0x10"),
        ("v 1,5 2 3", "1,5"),
        ("v 1 2 3 red", "red"),
    ],
)
def test_words_that_are_no_numbers_are_named_with_their_line(tmp_path, line, word):
    source = write_files(tmp_path, {"a.obj": triangle() + f"# fifth\n{line}\n"}) / "a.obj"
    with pytest.raises(InputError, match="line 6: ") as caught:
        ObjFrames().read(str(source))
    assert repr(word) in caught.value.message


def test_a_slash_without_anything_behind_it_is_understood():
    text = ObjText(triangle().replace("f 1 2 3", "f 1/ 2// 3/7").encode())
    assert text.topology().indices.tolist() == [0, 1, 2]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("word", ["1e300", "-1e39", "1e400"])
def test_coordinates_beyond_all_measure_are_refused(tmp_path, word):
    source = write_files(tmp_path, {"a.obj": triangle() + f"v 0 {word} 0\n"}) / "a.obj"
    with pytest.raises(InputError, match=r"line 5: .*(not finite|too far from the origin)"):
        ObjFrames().read(str(source))
