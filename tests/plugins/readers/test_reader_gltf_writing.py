"""glTF files written back: which positions are written, and that nothing else changes."""

from __future__ import annotations

import json
import struct
from dataclasses import replace

import numpy as np
import pytest

from gltf_files import QUAD, QUAD_FACES, GltfFile, ball, quad
from meshmark.errors import OutputError, UsageError
from meshmark.mesh.animation import InMemoryFrames
from meshmark.sources.reading import read
from meshmark.sources.writing import writer
from meshmark.testing.meshes import icosphere
from meshmark.testing.readers import ReaderSuite
from meshmark_plugins.readers import RECORDS
from meshmark_plugins.readers.gltf import writing
from meshmark_plugins.readers.gltf.reader import GltfReader

UP = np.array([0.0, 0.0, 1.0])
RECORD = {record.name: record for record in RECORDS}["gltf"]


class TestWrittenBack(ReaderSuite):
    @pytest.fixture
    def record(self):
        return RECORD

    @pytest.fixture
    def source(self, tmp_path):
        made = ball(bending=False)
        still = made.primitive(QUAD, QUAD_FACES)
        made.add("nodes", mesh=made.mesh(still), scale=[2, 3, 4], name="still")
        return made.save(tmp_path / "ball.glb")

    @pytest.fixture
    def output(self, tmp_path):
        place = tmp_path / "out"
        place.mkdir()
        return place / "marked.glb"


def chunks(path) -> tuple[dict, bytes]:
    data = path.read_bytes()
    size = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def written(tmp_path, made: GltfFile, change):
    """Mark the frames of a file by a function, and write it; return what is read of that."""
    reader = GltfReader()
    asset = reader.read(made.save(tmp_path / "plain.glb"))
    marked = replace(asset, meshes=tuple(mesh.map(change) for mesh in asset.meshes))
    reader.write(marked, asset, tmp_path / "marked.glb")
    return reader.read(str(tmp_path / "marked.glb"))


def test_what_follows_from_one_position_at_rest_is_written_exactly(tmp_path):
    made = ball()
    source = made.save(tmp_path / "plain.glb")
    plain = GltfReader().read(source)
    [mesh] = plain.meshes
    frames = mesh.source
    V = frames.geometry.vertices
    rest = V.points + np.random.default_rng(0).normal(0, 0.01, V.points.shape)
    moved = replace(frames.geometry, vertices=replace(V, points=rest.astype(np.float32)))
    marked = replace(mesh, source=replace(frames, geometry=moved))
    output = tmp_path / "marked.glb"
    GltfReader().write(replace(plain, meshes=(marked,)), plain, output)
    [found] = GltfReader().read(str(output)).meshes
    np.testing.assert_allclose(found.source.geometry.vertices.points, rest, atol=1e-6)
    for one, two in zip(marked, found, strict=True):
        np.testing.assert_allclose(one.points, two.points, atol=1e-6)


def waving(V: np.ndarray) -> np.ndarray:
    """Displacements to one side, by a wave."""
    return 0.3 * np.sin(3 * V[:, :1]) * [0, 1, 0]


def waving_ball() -> tuple[GltfFile, np.ndarray]:
    """Build a ball with a morph target that comes and goes, whose vertices split along a seam."""
    V, F = icosphere(3)
    seam = V[F].mean(axis=1)[:, 2] > 0
    F = np.where(seam[:, None], F + len(V), F)
    V = np.concatenate([V, V])
    made = GltfFile()
    primitive = made.primitive(V, F)
    primitive["targets"] = [{"POSITION": made.accessor(waving(V))}]
    made.add("nodes", mesh=made.mesh(primitive, weights=[0.0]), name="ball")
    made.animate(0, "weights", np.arange(3) / 24, [0, 1, 0.5])
    return made, V


def slide(made: GltfFile, V: np.ndarray, tmp_path) -> tuple[float, np.ndarray]:
    """Slide all vertices about the ball; return how far off they are, and the written target."""
    turn = np.array([[np.cos(0.1), np.sin(0.1), 0], [-np.sin(0.1), np.cos(0.1), 0], [0, 0, 1]])
    X = V @ turn
    planned = [X + w * waving(X) for w in (0.0, 1.0, 0.5)]
    # The frame of what stands still has no time.
    found = written(tmp_path, made, lambda f: f.moved(planned[int(np.nan_to_num(f.time))]))
    [mesh, *_] = found.meshes
    off = max(np.abs(frame.points - P).max() for frame, P in zip(mesh, planned, strict=True))
    return off, mesh.source.geometry.vertices.targets[0]


def test_morph_targets_follow_vertices_that_slide(tmp_path, monkeypatch):
    made, V = waving_ball()
    off, target = slide(made, V, tmp_path)
    _, after = (chunks(tmp_path / name)[0] for name in ("plain.glb", "marked.glb"))
    bounds = after["accessors"][after["meshes"][0]["primitives"][0]["targets"][0]["POSITION"]]
    np.testing.assert_allclose(bounds["max"], target.max(axis=0), atol=1e-7)
    monkeypatch.setattr(writing, "find_target_places", lambda *_: {})
    kept, same = slide(made, V, tmp_path)
    np.testing.assert_array_equal(same, waving(V).astype(np.float32))
    # The ball's triangles are chords.
    assert off < 0.2 * kept
    # Vertices at the seam stay together.
    half = len(V) // 2
    np.testing.assert_array_equal(target[:half], target[half:])


def test_morph_targets_of_several_meshes_stay(tmp_path):
    made, V = waving_ball()
    [first] = made.json["meshes"][0]["primitives"]
    other = made.primitive(V, None)
    other |= {"indices": first["indices"], "targets": first["targets"]}
    made.add("nodes", mesh=made.mesh(other), name="other")
    _, target = slide(made, V, tmp_path)
    np.testing.assert_array_equal(target, waving(V).astype(np.float32))


def test_frames_that_do_not_agree_are_met_in_the_mean(tmp_path):
    made = quad()
    made.animate(0, "translation", [0, 1 / 24, 2 / 24], np.zeros((3, 3)))

    def change(frame):
        # The first frame was not marked, and does not count.
        return frame.moved(frame.points + UP * [0, 1, 3][int(frame.time)])

    found = written(tmp_path, made, change)
    np.testing.assert_allclose(found.meshes[0][0].points, QUAD + [[0, 0, 2]] * 4, atol=1e-6)


def test_nothing_but_positions_and_their_bounds_changes(tmp_path):
    made = ball()
    made.json["extras"] = {"ä": [1e-30, 12345678901234567890, "\u2028"]}
    # Rows of positions and something else between.
    rows = np.full((4, 5), 7, dtype="<f4")
    rows[:, 1:4] = QUAD
    view = made.view(rows.tobytes(), byteStride=20)
    described = made.describe(QUAD)
    position = made.add("accessors", bufferView=view, byteOffset=4, **described)
    made.add("nodes", mesh=made.mesh({"attributes": {"POSITION": position}}), name="rows")
    written(tmp_path, made, lambda frame: frame.moved(frame.points + 0.25))
    (before, plain), (after, marked) = (
        chunks(tmp_path / name) for name in ("plain.glb", "marked.glb")
    )
    ours = made.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
    for index in (ours, position):
        bounds = after["accessors"][index].pop("min"), after["accessors"][index].pop("max")
        assert np.all(np.array(bounds[0]) <= bounds[1])
    assert bounds == ([0.25] * 3, [1.25, 1.25, 0.25])
    assert after == before
    differing = np.flatnonzero(np.frombuffer(plain, "u1") != np.frombuffer(marked, "u1"))
    places = [
        made.json["bufferViews"][made.json["accessors"][i]["bufferView"]] for i in (ours, position)
    ]
    inside = [
        (differing >= place["byteOffset"]) & (differing < place["byteOffset"] + place["byteLength"])
        for place in places
    ]
    assert len(differing)
    assert np.logical_or(*inside).all()
    again = np.frombuffer(marked, "<f4", 20, places[1]["byteOffset"]).reshape(4, 5)
    np.testing.assert_array_equal(again[:, [0, 4]], 7)
    np.testing.assert_allclose(again[:, 1:4], QUAD + 0.25)


def test_a_mesh_of_two_nodes_takes_what_suits_both(tmp_path):
    made = quad()
    made.add("nodes", mesh=0, scale=[1, 1, 2], name="large")

    def change(frame):
        return frame.moved(frame.points + UP)

    found = written(tmp_path, made, change)
    # Least squares of z = 1 and 2 z = 1.
    z = [mesh[0].points[:, 2] for mesh in found.meshes]
    np.testing.assert_allclose(z, [[0.6] * 4, [1.2] * 4], atol=1e-6)


def test_what_is_scaled_flat_stays_finite(tmp_path):
    made = quad()
    made.json["nodes"][0]["scale"] = [1, 1, 0]
    found = written(tmp_path, made, lambda frame: frame.moved(frame.points + 0.5))
    moved = QUAD + [[0.5, 0.5, 0]] * 4
    np.testing.assert_allclose(found.meshes[0].source.geometry.vertices.points, moved, atol=1e-6)


def test_other_chunks_and_other_meshes_stay(tmp_path):
    made = quad()
    other = made.primitive(QUAD + 3, QUAD_FACES)
    made.add("nodes", mesh=made.mesh(other), name="other")
    source = tmp_path / "plain.glb"
    data = bytearray(made.binary()) + struct.pack("<I4s", 4, b"XYZ ") + b"mine"
    data[8:12] = struct.pack("<I", len(data))
    source.write_bytes(data)
    asset = read(source)
    marked = asset.meshes[0].map(lambda frame: frame.moved(frame.points + 1))
    output = tmp_path / "marked.glb"
    writer(asset, output)(replace(asset, meshes=(marked,)))
    assert output.read_bytes().endswith(b"XYZ mine")
    found = read(output)
    np.testing.assert_allclose(found.meshes[0][0].points, QUAD + 1)
    np.testing.assert_array_equal(found.meshes[1][0].points, QUAD + 3)


def draco(made: GltfFile) -> None:
    primitive = made.json["meshes"][0]["primitives"][0]
    primitive["extensions"] = {"KHR_draco_mesh_compression": {}}


def sparse_over_nothing(made: GltfFile) -> None:
    accessor = made.json["accessors"][0]
    del accessor["bufferView"]
    listed = made.view(np.arange(3, dtype="<u2").tobytes())
    accessor["sparse"] = {
        "count": 3,
        "indices": {"bufferView": listed, "componentType": 5123},
        "values": {"bufferView": 0},
    }


def shared(made: GltfFile) -> None:
    second = made.add("accessors", bufferView=0, **made.describe(QUAD))
    made.mesh({"attributes": {"POSITION": second}})


def also_times(made: GltfFile) -> None:
    made.add("accessors", bufferView=0, byteOffset=44, **made.describe(QUAD[:1, :1]))


@pytest.mark.parametrize(
    ("spoil", "wanted"),
    [
        (draco, r"meshes\[0\].primitives\[0\] is compressed by Draco, .*--uncompress writes"),
        (sparse_over_nothing, r"accessors\[0\] is sparse, .*--uncompress writes"),
        (shared, r"accessors\[2\] shares data with positions"),
        (also_times, r"accessors\[2\] shares data with positions"),
    ],
)
def test_what_cannot_be_replaced_is_refused_before_any_work(tmp_path, spoil, wanted):
    made = quad()
    source = made.save(tmp_path / "plain.glb")
    asset = read(source)
    spoil(made)
    made.save(tmp_path / "plain.glb")
    with pytest.raises(UsageError, match=rf"plain.glb: {wanted}.*a \.usdc always can"):
        writer(asset, tmp_path / "marked.glb")


def test_positions_between_other_numbers_are_not_shared(tmp_path):
    made = quad()
    rows = np.hstack([QUAD, QUAD]).astype("<f4")
    view = made.view(rows.tobytes(), byteStride=24)
    for begin, name in ((0, "POSITION"), (12, "NORMAL")):
        made.add("accessors", bufferView=view, byteOffset=begin, **made.describe(QUAD))
        attributes = made.json["meshes"][0]["primitives"][0]["attributes"]
        attributes[name] = len(made.json["accessors"]) - 1
    begins = made.json["bufferViews"][view]["byteOffset"]
    written(tmp_path, made, lambda frame: frame.moved(frame.points + 1))
    data = np.frombuffer(chunks(tmp_path / "marked.glb")[1], "<f4", 24, begins).reshape(4, 6)
    np.testing.assert_array_equal(data, np.hstack([QUAD + 1, QUAD]))


def test_what_is_no_copy_of_the_source_is_refused(tmp_path):
    asset = GltfReader().read(quad().save(tmp_path / "plain.glb"))
    [mesh] = asset.meshes
    late = replace(
        mesh, times=np.array([3.0]), source=InMemoryFrames((replace(mesh[0], time=3.0),))
    )
    output = tmp_path / "marked.glb"
    with pytest.raises(UsageError, match="/quad: the marked copy has other vertices or times"):
        GltfReader().write(replace(asset, meshes=(late,)), asset, output)
    far = mesh.map(lambda frame: frame.moved(frame.points + 1e39))
    with pytest.raises(OutputError, match="beyond the range"):
        GltfReader().write(replace(asset, meshes=(far,)), asset, output)
    assert not output.exists()
