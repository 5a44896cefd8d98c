"""What is read of glTF files, against what follows from the specification by hand."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest

from gltf_files import QUAD, QUAD_FACES, GltfFile, ball, quad
from meshmark.embedding.outputs import check_output
from meshmark.errors import InputError, OutputError, UsageError
from meshmark.sources.isolation.reading import read_isolated
from meshmark.testing.readers import ReaderSuite
from meshmark_plugins.readers import RECORDS
from meshmark_plugins.readers.gltf.reader import GltfReader

RECORD = {record.name: record for record in RECORDS}["gltf"]
QUARTER = [0, 0, np.sqrt(0.5), np.sqrt(0.5)]  # turn about z
UP = np.array([0.0, 0.0, 1.0])


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


@pytest.fixture
def read(tmp_path):
    """Return a function that writes a file and reads it."""

    def save_and_read(made, **parameters):
        return GltfReader(**parameters).read(made.save(tmp_path / "made.glb"))

    return save_and_read


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


def test_nodes_place_their_meshes_in_world_space(read):
    made = quad()
    made.json["nodes"][0].update(translation=[1, 2, 3], scale=[2, 1, 1])
    made.add("nodes", children=[0], rotation=QUARTER, name="turned")
    # In column order: x by 10, and 5 up.
    matrix = [10, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 5, 1]
    made.add("nodes", children=[1], matrix=matrix, name="top")
    [mesh] = read(made).meshes
    local = QUAD * [2, 1, 1] + [1, 2, 3]
    turned = np.stack([-local[:, 1], local[:, 0], local[:, 2]], axis=1)
    np.testing.assert_allclose(mesh[0].points, turned * [10, 1, 1] + [0, 0, 5], atol=1e-12)
    assert mesh.prim == "/top/turned/quad"
    assert np.isnan(mesh.times).all()


@pytest.mark.parametrize(
    ("interpolation", "values", "wanted"),
    [
        ("STEP", [0, 4], [0, 0, 0, 0, 4]),
        ("LINEAR", [0, 4], [0, 1, 2, 3, 4]),
        # h00, h10, h01 and h11 at 0, 1/4, .., 1 over a second, with slopes 8 out and 0 in.
        ("CUBICSPLINE", [[9, 0, 8], [0, 4, 9]], [0, 1.75, 3, 3.75, 4]),
    ],
)
def test_values_between_keys(read, interpolation, values, wanted):
    made = quad()
    moves = np.reshape(values, (-1, 1)) * [[1.0, 0, 0]]
    made.animate(0, "translation", [1, 2], moves, interpolation=interpolation)
    asset = read(made, fps=4)
    [mesh] = asset.meshes
    np.testing.assert_array_equal(mesh.times, [4, 5, 6, 7, 8])
    np.testing.assert_allclose([frame.points[0, 0] for frame in mesh], wanted, atol=1e-6)


@pytest.mark.parametrize("sign", [1, -1])
def test_rotations_keep_their_speed_and_take_the_shorter_way(read, sign):
    made = quad()
    angle = np.radians(80)
    end = sign * np.array([0, 0, np.sin(angle / 2), np.cos(angle / 2)])
    made.animate(0, "rotation", [0, 1], [[0, 0, 0, 1], 3 * end])
    [mesh] = read(made, fps=4).meshes
    corners = np.array([frame.points[1] for frame in mesh])
    angles = np.degrees(np.arctan2(corners[:, 1], corners[:, 0]))
    np.testing.assert_allclose(angles, [0, 20, 40, 60, 80], atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(corners, axis=1), 1, atol=1e-6)


def test_an_animated_matrix_is_taken_apart(read):
    made = quad()
    # Mirrored in x, turned a quarter about z, scaled by 3, moved.
    made.json["nodes"][0]["matrix"] = [0, -3, 0, 0, -3, 0, 0, 0, 0, 0, 3, 0, 1, 2, 3, 1]
    still = read(made).meshes[0][0].points
    made.animate(0, "translation", [0, 1], [[1, 2, 3], [1, 2, 4]])
    mesh = read(made, fps=2).meshes[0]
    np.testing.assert_allclose(mesh[0].points, still, atol=1e-9)
    np.testing.assert_allclose(mesh[2].points, still + UP, atol=1e-9)


def skinned_quad(weights, dtype="f4", joints=((0, 1, 0, 0),) * 4, **members):
    made = GltfFile()
    primitive = made.primitive(QUAD, QUAD_FACES)
    primitive["attributes"]["JOINTS_0"] = made.accessor(joints, "u2")
    primitive["attributes"]["WEIGHTS_0"] = made.accessor(weights, dtype, **members)
    made.add("nodes", mesh=made.mesh(primitive), skin=0, translation=[100, 0, 0])
    made.add("nodes", translation=[1, 0, 0])
    made.add("nodes", translation=[0, 5, 0], children=[3])
    made.add("nodes", rotation=QUARTER)
    away = np.eye(4)
    away[:3, 3] = [-1, 0, 0]
    matrices = made.accessor([away.T.reshape(-1), np.eye(4).reshape(-1)])
    made.add("skins", joints=[1, 3], inverseBindMatrices=matrices)
    return made


def test_skins_blend_their_joints_and_ignore_the_node(read):
    weights = [[1, 0, 0, 0], [0, 1, 0, 0], [0.5, 0.5, 0, 0], [3, 1, 0, 0]]
    [mesh] = read(skinned_quad(weights)).meshes
    # The first joint leaves points where they are; the second turns them, and lifts them by 5.
    turned = np.stack([-QUAD[:, 1], QUAD[:, 0] + 5, QUAD[:, 2]], axis=1)
    share = np.array([0, 1, 0.5, 0.25])[:, None]
    wanted = (1 - share) * QUAD + share * turned
    np.testing.assert_allclose(mesh[0].points, wanted, atol=1e-6)


def test_weights_may_be_normalised_integers(read):
    weights = [[255, 0, 0, 0], [0, 255, 0, 0], [128, 127, 0, 0], [51, 204, 0, 0]]
    [mesh] = read(skinned_quad(weights, "u1", normalized=True)).meshes
    turned = np.stack([-QUAD[:, 1], QUAD[:, 0] + 5, QUAD[:, 2]], axis=1)
    share = np.array([0, 1, 127 / 255, 0.8])[:, None]
    np.testing.assert_allclose(mesh[0].points, (1 - share) * QUAD + share * turned, atol=1e-6)


def test_further_sets_of_joints_count(read):
    made = skinned_quad([[1, 0, 0, 0]] * 4)
    attributes = made.json["meshes"][0]["primitives"][0]["attributes"]
    attributes["JOINTS_1"] = made.accessor([[1, 0, 0, 0]] * 4, "u1")
    attributes["WEIGHTS_1"] = made.accessor([[1, 0, 0, 0]] * 4)
    turned = np.stack([-QUAD[:, 1], QUAD[:, 0] + 5, QUAD[:, 2]], axis=1)
    np.testing.assert_allclose(read(made).meshes[0][0].points, (QUAD + turned) / 2, atol=1e-6)


def test_vertices_without_joints_stay_with_the_node(read):
    [mesh] = read(skinned_quad([[0, 0, 0, 0], *[[1, 0, 0, 0]] * 3])).meshes
    wanted = QUAD + np.outer([1, 0, 0, 0], [100, 0, 0])
    np.testing.assert_allclose(mesh[0].points, wanted, atol=1e-6)


def morphing_quad():
    made = quad()
    up = np.tile(UP, (4, 1))
    sparse = {
        "count": 1,
        "indices": {"bufferView": made.view(b"\2\0"), "componentType": 5123},
        "values": {"bufferView": made.view(np.array([5, 0, 0], "<f4").tobytes())},
    }
    sparse_target = made.add("accessors", **made.describe(QUAD), sparse=sparse)
    targets = [{"POSITION": made.accessor(up)}, {"POSITION": sparse_target}, {"NORMAL": 0}]
    made.json["meshes"][0]["primitives"][0]["targets"] = targets
    return made


SPARSE = np.array([[0, 0, 0], [0, 0, 0], [5, 0, 0], [0, 0, 0]])


@pytest.mark.parametrize(
    ("mesh", "node", "wanted"),
    [
        (None, None, QUAD),
        ([0.5, 2, 9], None, QUAD + UP / 2 + 2 * SPARSE),
        ([0.5, 2, 9], [1, 0, 0], QUAD + UP),
    ],
)
def test_morph_targets_have_weights_of_mesh_or_node(read, mesh, node, wanted):
    made = morphing_quad()
    made.json["meshes"][0].update({"weights": mesh} if mesh else {})
    made.json["nodes"][0].update({"weights": node} if node else {})
    np.testing.assert_allclose(read(made).meshes[0][0].points, wanted, atol=1e-6)


def test_weights_of_morph_targets_are_animated(read):
    made = morphing_quad()
    made.animate(0, "weights", [0, 1], [[0, 0, 0], [1, 2, 3]])
    mesh = read(made, fps=2).meshes[0]
    np.testing.assert_allclose(mesh[1].points, QUAD + UP / 2 + SPARSE, atol=1e-6)


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


@pytest.mark.parametrize(
    ("times", "fps", "codes"),
    [
        (np.arange(25) / 24, 24, range(25)),
        # Keys of frame 1 on, as Blender writes them; float32 seconds.
        (np.arange(1, 250) / 30, 30, range(1, 250)),
        # Even keys that are not dense enough for what is between them.
        ([0, 1], 24, range(25)),
        (np.arange(5) / 10, 30, range(13)),
        # A sudden change does not count.
        ([0, 0.04, 0.08, 0.085, 0.12, 0.16, 0.2], 25, range(6)),
        (np.arange(48) / (24 / 1.001), 24 / 1.001, range(48)),
        # Shorter than a frame; nothing but a key.
        ([0.51, 0.512], 500, [255, 256]),
        ([0.51], 24, [12.24]),
    ],
)
def test_time_codes_are_frames_of_the_densest_keys(read, times, fps, codes):
    made = quad()
    made.animate(0, "translation", times, np.outer(times, [1, 0, 0]))
    asset = read(made)
    assert asset.fps == pytest.approx(fps, rel=1e-6)
    np.testing.assert_allclose(asset.meshes[0].times, list(codes), rtol=1e-6)


def test_what_a_clip_does_not_change_has_no_time(read):
    made = ball()
    made.add("nodes", mesh=made.mesh(made.primitive(QUAD, QUAD_FACES)), name="floor")
    asset = read(made)
    assert {mesh.prim: len(mesh) for mesh in asset.meshes} == {"/root/ball": 17, "/floor": 1}


def test_clips_are_chosen_by_name(read):
    made = quad()
    made.animate(0, "translation", [0, 1], [[0, 0, 0], [1, 0, 0]])
    made.json["animations"][0]["name"] = "Walk"
    made.json["animations"].append({"channels": [], "samplers": [], "name": "Run"})
    made.animate(0, "scale", [0, 2], [[1, 1, 1], [2, 2, 2]])
    made.json["animations"].append({"channels": [], "samplers": []})
    assert read(made).meshes[0][-1].points[1, 0] == 2
    assert read(made).notes == ("clip 'Walk' is read; there is also 'Run', 'animation2'",)
    run = read(made, clip="Run", fps=1).meshes[0]
    np.testing.assert_array_equal(run.times, [0, 1, 2])
    assert run[-1].points[1, 0] == 2
    assert len(read(made, clip="animation2").meshes[0]) == 1
    with pytest.raises(UsageError, match="no clip 'Crawl'; there is 'Walk', 'Run', 'animation2'"):
        read(made, clip="Crawl")
    with pytest.raises(UsageError, match="fps"):
        GltfReader(fps=-1)


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


def compressed(made: GltfFile, index: int, mode: str, extension: str) -> None:
    """Compress the data of an accessor by meshoptimizer, in place of what is there."""
    meshopt = pytest.importorskip("meshopt", reason="meshopt, an optional library, is absent")
    accessor = made.json["accessors"][index]
    view = made.json["bufferViews"][accessor["bufferView"]]
    begin, length = view["byteOffset"], view["byteLength"]
    data = np.frombuffer(bytes(made.data[begin : begin + length]), np.uint8)
    rows = data.reshape(accessor["count"], -1)
    values = rows if mode == "ATTRIBUTES" else rows.view(f"<u{rows.shape[1]}")[:, 0]
    packed = meshopt.encode_gltf_buffer(values, mode)
    told = {"count": len(rows), "byteStride": rows.shape[1], "mode": mode}
    made.view(packed)
    where = made.json["bufferViews"].pop()
    view["extensions"] = {extension: {**where, **told}}
    # Nothing is left for those that cannot decode.
    view["buffer"] = 1


@pytest.mark.parametrize("extension", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_meshopt_is_decoded(tmp_path, extension):
    made = ball()
    plain = GltfReader().read(made.save(tmp_path / "plain.glb")).meshes[0]
    primitive = made.json["meshes"][0]["primitives"][0]
    compressed(made, primitive["attributes"]["POSITION"], "ATTRIBUTES", extension)
    compressed(made, primitive["indices"], "INDICES", extension)
    fallback = {"byteLength": 10**6, "extensions": {extension: {"fallback": True}}}
    made.json["buffers"] = [{"byteLength": len(made.data)}, fallback]
    found = GltfReader().read(made.save(tmp_path / "packed.glb")).meshes[0]
    for one, two in zip(plain, found, strict=True):
        np.testing.assert_array_equal(one.points, two.points)
        np.testing.assert_array_equal(one.faces, two.faces)


def test_draco_is_decoded_by_the_ids_of_attributes(tmp_path):
    draco = pytest.importorskip("DracoPy", reason="DracoPy, an optional library, is absent")
    made = skinned_quad([[1, 0, 0, 0], [0, 1, 0, 0], [0.5, 0.5, 0, 0], [0.75, 0.25, 0, 0]])
    plain = GltfReader().read(made.save(tmp_path / "plain.glb")).meshes[0]
    vertices = plain.source.geometry.vertices
    packed = draco.encode(
        vertices.points,
        faces=plain[0].faces,
        quantization_bits=20,
        preserve_order=True,
        generic_attributes={7: vertices.joints.astype("u2"), 9: vertices.weights.astype("f4")},
    )
    primitive = made.json["meshes"][0]["primitives"][0]
    stored = {each["unique_id"]: each for each in draco.decode(packed).attributes}
    [position] = [number for number in stored if number not in (7, 9)]
    numbers = {"POSITION": position, "JOINTS_0": 7, "WEIGHTS_0": 9}
    extension = {"bufferView": made.view(packed), "attributes": numbers}
    primitive["extensions"] = {"KHR_draco_mesh_compression": extension}
    for number in (*primitive["attributes"].values(), primitive["indices"]):
        del made.json["accessors"][number]["bufferView"]
    found = GltfReader().read(made.save(tmp_path / "packed.glb")).meshes[0]
    np.testing.assert_allclose(found[0].points, plain[0].points, atol=1e-5)
    np.testing.assert_array_equal(found[0].faces, plain[0].faces)
    numbers["WEIGHTS_0"] = 4
    with pytest.raises(InputError, match=r"attributes.WEIGHTS_0 is 4, an attribute that"):
        GltfReader().read(made.save(tmp_path / "packed.glb"))


def test_missing_decoders_are_named(tmp_path, monkeypatch):
    made = quad()
    view = made.view(b"DRACO\2\2\1\1\0\0\0\4\4" + b"\0" * 50)
    primitive = made.json["meshes"][0]["primitives"][0]
    draco = {"bufferView": view, "attributes": {"POSITION": 0}}
    primitive["extensions"] = {"KHR_draco_mesh_compression": draco}
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    monkeypatch.setitem(sys.modules, "meshopt", None)
    # There may be data for everyone, too.
    assert len(GltfReader().read(made.save(tmp_path / "both.glb")).meshes[0][0].points) == 4
    del made.json["accessors"][0]["bufferView"]
    with pytest.raises(InputError, match=r"primitives\[0\].* Draco, .*'meshmark\[gltf\]'"):
        GltfReader().read(made.save(tmp_path / "draco.glb"))
    del primitive["extensions"]
    made.json["accessors"][0]["bufferView"] = 0
    length = made.json["bufferViews"][0]["byteLength"]
    packed = {"buffer": 0, "byteLength": 40, "count": 4, "byteStride": 12, "mode": "ATTRIBUTES"}
    made.json["bufferViews"][0]["extensions"] = {"EXT_meshopt_compression": packed}
    assert length == 48
    assert len(GltfReader().read(made.save(tmp_path / "both.glb")).meshes[0][0].points) == 4
    made.json["bufferViews"][0]["buffer"] = 1
    made.json["buffers"] = [{"byteLength": len(made.data)}, {"byteLength": 48}]
    with pytest.raises(InputError, match=r"bufferViews\[0\].* meshoptimizer, .*'meshmark\[gltf\]'"):
        GltfReader().read(made.save(tmp_path / "meshopt.glb"))


def test_json_in_either_suffix(tmp_path):
    made = quad()
    text = made.save(tmp_path / "text.gltf")
    assert json.loads((tmp_path / "text.gltf").read_text())["meshes"]
    binary = tmp_path / "binary.gltf"
    binary.write_bytes(made.binary())
    assert len(GltfReader().read(str(binary)).meshes) == len(GltfReader().read(text).meshes)
