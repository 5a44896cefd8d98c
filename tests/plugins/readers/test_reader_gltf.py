"""What is read of glTF files, against what follows from the specification by hand."""

from __future__ import annotations

import json

import numpy as np
import pytest

from gltf_files import QUAD, QUAD_FACES, GltfFile, ball, quad
from meshmark.embedding.outputs import check_output
from meshmark.errors import OutputError
from meshmark.sources.isolation.reading import read_isolated
from meshmark.testing.readers import ReaderSuite
from meshmark_plugins.readers import RECORDS
from meshmark_plugins.readers.gltf.reader import GltfReader

RECORD = {record.name: record for record in RECORDS}["gltf"]


class TestGlb(ReaderSuite):
    @pytest.fixture
    def record(self):
        return RECORD

    @pytest.fixture
    def source(self, tmp_path):
        return ball().save(tmp_path / "ball.glb")

    @pytest.fixture
    def broken_source(self, tmp_path):
        path = tmp_path / "broken.glb"
        path.write_bytes(b"glTF\2\0\0\0 of some kind")
        return str(path)


class TestGltfWithBuffer(TestGlb):
    @pytest.fixture
    def source(self, tmp_path):
        made = ball()
        (tmp_path / "the data.bin").write_bytes(made.data)
        return made.save_with_buffer(tmp_path / "ball.gltf", "the%20data.bin")

    @pytest.fixture
    def broken_source(self, tmp_path):
        path = tmp_path / "broken.gltf"
        path.write_text("o cube\nv 0 0 0\n")
        return str(path)


def test_all_forms_hold_the_same(tmp_path):
    made = ball()
    (tmp_path / "data.bin").write_bytes(bytes(made.data) + b"and more")
    sources = [
        made.save_with_buffer(tmp_path / "a.gltf", "data.bin"),
        made.save(tmp_path / "b.gltf"),
        made.save(tmp_path / "c.glb"),
        made.save(tmp_path / "d.GLB"),
    ]
    first, *others = (GltfReader().read(source).meshes[0] for source in sources)
    for other in others:
        for one, two in zip(first, other, strict=True):
            np.testing.assert_array_equal(one.points, two.points)


@pytest.mark.parametrize(
    ("mode", "indices", "wanted"),
    [
        (None, None, [[0, 1, 2]]),
        (4, [0, 1, 2, 0, 2, 3, 1], [[0, 1, 2], [0, 2, 3]]),
        (5, [0, 1, 3, 2], [[0, 1, 3], [3, 1, 2]]),
        (5, [0, 1, 2, 2, 3, 0], [[0, 1, 2], [3, 2, 0]]),
        (6, [0, 1, 2, 3], [[0, 1, 2], [0, 2, 3]]),
    ],
)
def test_lists_strips_and_fans(read, mode, indices, wanted):
    made = GltfFile()
    primitive = made.primitive(QUAD, indices)
    primitive.update({} if mode is None else {"mode": mode})
    made.add("nodes", mesh=made.mesh(primitive))
    found = read(made).meshes[0][0].faces
    np.testing.assert_array_equal(np.sort(found, axis=1), np.sort(wanted, axis=1))
    # Turned the same way.
    for face, other in zip(found.tolist(), wanted, strict=True):
        assert other in (face, face[1:] + face[:1], face[2:] + face[:2])


def test_points_and_lines_are_named(read):
    made = quad()
    made.json["meshes"][0]["primitives"].append({**made.primitive(QUAD, None), "mode": 1})
    lines = made.mesh({**made.primitive(QUAD, None), "mode": 3})
    made.add("nodes", mesh=lines, name="lines")
    asset = read(made)
    assert [mesh.prim for mesh in asset.meshes] == ["/quad"]
    assert len(asset.meshes[0][0].points) == 4
    assert [(each.prim, each.reason) for each in asset.left_out] == [
        ("/quad", "1 of its primitives are points or lines"),
        ("/lines", "it has points or lines, and no triangles"),
    ]


def test_primitives_that_share_vertices_are_one_mesh(read):
    made = GltfFile()
    shared = made.accessor(QUAD)
    first, second = (
        {"attributes": {"POSITION": shared}, "indices": made.accessor(face, "u1")}
        for face in QUAD_FACES
    )
    other = made.primitive(QUAD + 1, QUAD_FACES)
    made.add("nodes", mesh=made.mesh(first, other, second))
    [mesh] = read(made).meshes
    assert len(mesh[0].points) == 8
    np.testing.assert_array_equal(mesh[0].faces, [[0, 1, 2], [4, 5, 6], [4, 6, 7], [0, 2, 3]])


def test_faces_with_bad_indices_are_a_flaw(read):
    made = GltfFile()
    made.add("nodes", mesh=made.mesh(made.primitive(QUAD, [[0, 1, 2], [0, 2, 9]])))
    [mesh] = read(made).meshes
    assert mesh.flaw == "1 of 2 faces cannot be used: face index 9 is out of range for 4 points"


@pytest.mark.parametrize("dtype", ["i1", "u1", "i2", "u2"])
@pytest.mark.parametrize("normalized", [True, False])
def test_positions_may_be_quantised(read, dtype, normalized):
    made = GltfFile()
    most = np.iinfo(dtype).max
    # Rows of four bytes or eight, as alignment has them.
    rows = np.zeros((4, 4), dtype)
    rows[:, :3] = QUAD * most
    rows[0, 0] = np.iinfo(dtype).min
    view = made.view(rows.tobytes(), byteStride=rows.itemsize * 4)
    described = made.describe(rows[:, :3], dtype)
    position = made.add("accessors", bufferView=view, normalized=normalized, **described)
    made.add("nodes", mesh=made.mesh({"attributes": {"POSITION": position}}))
    wanted = rows[:, :3].astype(float)
    if normalized:
        wanted = np.maximum(wanted / most, -1)
    np.testing.assert_allclose(read(made).meshes[0][0].points, wanted, atol=1e-12)


def test_paths_are_valid_and_each_its_own(read):
    made = GltfFile()
    mesh = made.mesh(made.primitive(QUAD, QUAD_FACES), name="mesh")
    names = ["a/b", "a b", "1st", "Kopf.Fuß", "", None]
    for name in names:
        made.add("nodes", mesh=mesh, **({} if name is None else {"name": name}))
    made.json["nodes"][0]["children"] = [6, 7]
    made.add("nodes", mesh=mesh, name="a_b")
    made.add("nodes", mesh=mesh, name="a_b")
    assert [found.prim for found in read(made).meshes] == [
        "/a_b",
        "/a_b/a_b",
        "/a_b/a_b_2",
        "/a_b_2",
        "/_1st",
        "/Kopf_Fuß",
        "/mesh",
        "/mesh_2",
    ]


@pytest.mark.parametrize(
    ("scenes", "wanted"),
    [
        ({}, ["/one", "/two"]),
        ({"scenes": [{"nodes": [1]}, {"nodes": [0]}]}, ["/two"]),
        ({"scenes": [{"nodes": [1]}, {"nodes": [0]}], "scene": 1}, ["/one"]),
    ],
)
def test_the_default_scene_is_read(read, scenes, wanted):
    made = GltfFile(**scenes)
    mesh = made.mesh(made.primitive(QUAD, QUAD_FACES))
    made.add("nodes", mesh=mesh, name="one")
    made.add("nodes", mesh=mesh, name="two")
    asset = read(made)
    assert [found.prim for found in asset.meshes] == wanted
    assert asset.notes == (("1 meshes of other scenes are not read",) if scenes else ())


def test_a_mesh_that_cannot_be_read_does_not_hide_the_others(read):
    made = quad()
    bad = made.primitive(np.where(QUAD > 0, np.nan, 0), QUAD_FACES)
    made.add("nodes", mesh=made.mesh(bad), name="bad")
    asset = read(made)
    assert [mesh.prim for mesh in asset.meshes] == ["/quad"]
    [left] = asset.left_out
    assert (left.prim, left.reason) == ("/bad", "accessors[2]: element 1 is not finite")


def test_files_are_known_to_those_who_hash_and_who_write(tmp_path):
    made = quad()
    made.add("images", uri="textures/skin.png")
    made.add("images", uri="../else where.png")
    made.add("images", uri="https://example.org/x.png")
    (tmp_path / "scene").mkdir()
    buffer = tmp_path / "scene" / "data.bin"
    buffer.write_bytes(made.data)
    path = tmp_path / "scene" / "a.gltf"
    source = made.save_with_buffer(path, "data.bin")
    reader = GltfReader()
    assert reader.files(source) == [path, buffer]
    image, outside = path.parent / "textures/skin.png", path.parent / "../else where.png"
    assert reader.files_in_reach(source) == [path, buffer, image, outside]
    asset = read_isolated(source)
    assert [file for file, _ in asset.facts.files] == [str(path), str(buffer)]
    for taken in (buffer, tmp_path / "else where.png"):
        with pytest.raises(OutputError, match="part of the source"):
            check_output(taken, asset, deliver=False)
    path.write_text("{")
    assert reader.files_in_reach(source) == [path]
    assert reader.files_in_reach(str(tmp_path / "gone.glb")) == []


def test_json_in_either_suffix(tmp_path):
    made = quad()
    text = made.save(tmp_path / "text.gltf")
    assert json.loads((tmp_path / "text.gltf").read_text())["meshes"]
    binary = tmp_path / "binary.gltf"
    binary.write_bytes(made.binary())
    assert len(GltfReader().read(str(binary)).meshes) == len(GltfReader().read(text).meshes)
