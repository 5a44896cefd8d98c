"""Forms in which glTF files hold positions, each written back in its own form, or plainly."""

from __future__ import annotations

import base64
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gltf_files import QUAD, GltfFile, glb, quad
from gltf_writing import SHIFT, bounds, mark, shifted
from meshmark.errors import InputError, OutputError, UsageError
from meshmark.sources.writing import writer
from meshmark.testing.meshes import icosphere
from meshmark_plugins.readers.gltf.container import read_container
from meshmark_plugins.readers.gltf.reader import GltfReader


def buffer_file(folder: Path, made: GltfFile) -> str:
    """Write a text file whose buffer and texture are beside it."""
    (folder / "my data.bin").write_bytes(bytes(made.data))
    (folder / "skin.png").write_bytes(b"")
    made.json["images"] = [{"uri": "skin.png"}, {"uri": "data:image/png;base64,"}]
    return made.save_with_buffer(folder / "plain.gltf", "my%20data.bin")


def test_a_file_beside_the_source_becomes_one_beside_the_output(tmp_path):
    made = quad()
    source = buffer_file(tmp_path, made)
    written = mark(source, tmp_path / "a b.gltf")
    assert written["buffers"] == [{"byteLength": len(made.data), "uri": "a%20b.gltf.0.bin"}]
    assert (tmp_path / "my data.bin").read_bytes() == bytes(made.data)
    assert written["images"] == made.json["images"]
    data = (tmp_path / "a b.gltf.0.bin").read_bytes()
    np.testing.assert_array_equal(np.frombuffer(data, "<f4", 12).reshape(4, 3), QUAD + SHIFT)
    assert data[48:] == bytes(made.data[48:])
    files = GltfReader().files(str(tmp_path / "a b.gltf"))
    assert [file.name for file in files] == ["a b.gltf", "a b.gltf.0.bin"]


def test_images_are_found_from_another_folder(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "out").mkdir()
    source = buffer_file(tmp_path / "in", quad())
    written = mark(source, tmp_path / "out" / "marked.gltf")
    assert written["images"] == [{"uri": "../in/skin.png"}, {"uri": "data:image/png;base64,"}]


def test_a_buffer_of_the_source_is_never_written_over(tmp_path):
    made = quad()
    (tmp_path / "marked.gltf.0.bin").write_bytes(bytes(made.data))
    source = made.save_with_buffer(tmp_path / "plain.gltf", "marked.gltf.0.bin")
    asset = GltfReader().read(source)
    with pytest.raises(OutputError, match=r"marked.gltf.0.bin: is part of the source"):
        writer(asset, tmp_path / "marked.gltf")
    with pytest.raises(OutputError, match=r"marked.gltf.0.bin: is part of the source"):
        writer(asset, tmp_path / "marked.gltf", parameters={"uncompress": True})


def test_a_buffer_that_is_missing_is_named_before_any_work(tmp_path):
    made = quad()
    source = buffer_file(tmp_path, made)
    asset = GltfReader().read(source)
    (tmp_path / "my data.bin").unlink()
    with pytest.raises(InputError, match=r"plain.gltf: buffers\[0\].uri names 'my data.bin'"):
        writer(asset, tmp_path / "marked.gltf")


def test_of_several_files_all_are_written_or_none(tmp_path):
    source = buffer_file(tmp_path, quad())
    asset = GltfReader().read(source)
    before = set(tmp_path.iterdir())
    # The name of the file itself would fit, that of its buffer does not.
    output = tmp_path / f"{'x' * 248}.gltf"
    with pytest.raises(OutputError, match="cannot be written"):
        GltfReader().write(shifted(asset), asset, output)
    assert set(tmp_path.iterdir()) == before


def test_data_in_the_text_stays_in_the_text(tmp_path):
    made = quad()
    source = made.save(tmp_path / "plain.gltf")
    written = mark(source, tmp_path / "marked.gltf")
    head, data = written["buffers"][0]["uri"].split(",")
    assert head == "data:application/octet-stream;base64"
    plain = base64.b64decode(data)
    assert plain[48:] == bytes(made.data[48:])
    assert [file.name for file in tmp_path.iterdir() if "bin" in file.name] == []
    written["buffers"] = json.loads(Path(source).read_text())["buffers"]
    assert bounds(written["accessors"][0]) == [[0.5, 0.25, 1], [1.5, 1.25, 1]]
    written["accessors"][0] = made.json["accessors"][0]
    assert written == json.loads(Path(source).read_text())


def test_the_form_follows_the_name_of_the_output(tmp_path):
    made = quad()
    text = made.save(tmp_path / "plain.gltf")
    assert "uri" not in mark(text, tmp_path / "marked.glb")["buffers"][0]
    binary = made.save(tmp_path / "plain.glb")
    written = mark(binary, tmp_path / "marked.gltf")
    assert written["buffers"][0]["uri"] == "marked.gltf.0.bin"


GRIDS = [("i2", 32767, True), ("i2", 20000, False), ("u2", 65535, True), ("u2", 60000, False)]


def on_grid(dtype: str, most: int, normalized: bool) -> GltfFile:
    """Put a ball on a grid, which its node undoes."""
    made = GltfFile(extensionsUsed=["KHR_mesh_quantization"])
    V, F = icosphere(2)
    values = np.zeros((len(V), 4), dtype=f"<{dtype}")
    values[:, :3] = np.rint((V + 1) / 2 * most if dtype[0] == "u" else V * most)
    view = made.view(values.tobytes(), byteStride=values.strides[0])
    described = made.describe(values[:, :3], dtype) | {"normalized": normalized}
    position = made.add("accessors", bufferView=view, **described)
    faces = made.accessor(np.reshape(F, -1), "u2")
    mesh = made.mesh({"attributes": {"POSITION": position}, "indices": faces})
    scale = 1.0 if normalized else 1.0 / most
    node = {"scale": [scale] * 3}
    if dtype[0] == "u":
        node = {"scale": [2 * scale] * 3, "translation": [-1.0] * 3}
    made.add("nodes", mesh=mesh, name="ball", **node)
    return made


def scattered(asset, size: float):
    """Move points at random; along no axis beyond what they had."""
    rng = np.random.default_rng(0)
    moves = rng.uniform(-size, size, asset.meshes[0][0].points.shape)

    def move(frame):
        return frame.moved(np.clip(frame.points + moves, -1, 1))

    return replace(asset, meshes=tuple(mesh.map(move) for mesh in asset.meshes))


@pytest.mark.parametrize(("dtype", "most", "normalized"), GRIDS)
def test_quantised_positions_are_rounded_to_their_grid(tmp_path, dtype, most, normalized):
    made = on_grid(dtype, most, normalized)
    reader = GltfReader()
    plain = reader.read(made.save(tmp_path / "plain.glb"))
    marked = scattered(plain, 0.01)
    writer(plain, tmp_path / "marked.glb")(marked)
    [found] = reader.read(str(tmp_path / "marked.glb")).meshes
    step = 2 / most if dtype[0] == "u" else 1 / most
    assert np.abs(found[0].points - marked.meshes[0][0].points).max() < 0.501 * step
    accessor = read_container(tmp_path / "marked.glb").root.members["accessors"][0]
    data = read_container(tmp_path / "marked.glb").binary
    values = np.frombuffer(data, f"<{dtype}", 4 * accessor["count"]).reshape(-1, 4)
    assert bounds(accessor) == [values[:, :3].min(0).tolist(), values[:, :3].max(0).tolist()]
    # What is between the rows stays.
    assert not values[:, 3].any()


def test_what_leaves_the_grid_stops_at_its_end(tmp_path):
    made = on_grid("u2", 65535, True)
    plain = GltfReader().read(made.save(tmp_path / "plain.glb"))
    writer(plain, tmp_path / "marked.glb")(shifted(plain))
    [found] = GltfReader().read(str(tmp_path / "marked.glb")).meshes
    wanted = np.minimum(plain.meshes[0][0].points + SHIFT, 1)
    np.testing.assert_allclose(found[0].points, wanted, atol=2e-5)


def test_a_grid_that_is_too_coarse_for_a_mark_is_told_before_any_work(tmp_path):
    made = on_grid("i1", 127, True)
    source = made.save(tmp_path / "plain.glb")
    plain = GltfReader().read(source)
    with pytest.raises(
        UsageError,
        match=r"plain.glb: meshes\[0\] is on a grid of 0.002 of its size, .*--uncompress w",
    ):
        writer(plain, tmp_path / "marked.glb")
    mark(source, tmp_path / "marked.glb", uncompress=True)


def test_quantised_vertices_are_written_as_floats(tmp_path):
    made = on_grid("i2", 20000, False)
    normals = made.accessor(np.full((162, 4), 127), "i1", normalized=True)
    made.json["accessors"][normals]["type"] = "VEC3"
    made.json["bufferViews"][-1]["byteStride"] = 4
    texture = made.accessor(np.full((162, 2), 65535), "u2", normalized=True)
    attributes = made.json["meshes"][0]["primitives"][0]["attributes"]
    attributes |= {"NORMAL": normals, "TEXCOORD_0": texture}
    before = bytes(made.data[: 162 * 8])
    written = mark(made.save(tmp_path / "plain.glb"), tmp_path / "marked.glb", uncompress=True)
    kinds = [written["accessors"][attributes[name]]["componentType"] for name in attributes]
    # glTF itself has normalised texture coordinates.
    assert kinds == [5126, 5126, 5123]
    assert "extensionsUsed" not in written
    assert "normalized" not in written["accessors"][normals]
    assert before not in (tmp_path / "marked.glb").read_bytes()


def test_what_shares_bytes_with_quantised_positions_stays(tmp_path):
    made = on_grid("i2", 20000, False)
    made.add("accessors", bufferView=0, byteOffset=8, **made.describe(np.zeros((1, 1)), "u4"))
    before = bytes(made.data[8:12])
    source = made.save(tmp_path / "plain.glb")
    written = mark(source, tmp_path / "marked.glb", uncompress=True)
    view = written["bufferViews"][written["accessors"][-1]["bufferView"]]
    data = bytes(read_container(tmp_path / "marked.glb").binary[view["byteOffset"] :])
    assert data[8:12] == before
    assert not any(data[:8] + data[12 : view["byteLength"]])


@pytest.mark.parametrize("uncompress", [False, True])
@pytest.mark.parametrize(
    ("members", "wanted"),
    [
        ({"images": 3}, "images is 3, not a list"),
        ({"images": [{"uri": 3}]}, r"images\[0\].uri is 3, not a text"),
        ({"extras": {"deep": 1e308 * 10}}, "a number beyond the range of float64"),
    ],
)
def test_nonsense_beside_the_meshes_is_told_before_any_work(tmp_path, members, wanted, uncompress):
    made = quad()
    asset = GltfReader().read(made.save(tmp_path / "plain.glb"))
    made.json |= {"buffers": [{"byteLength": len(made.data)}], **members}
    text = json.dumps(made.json).replace("Infinity", "1e999").encode()
    (tmp_path / "plain.glb").write_bytes(glb((b"JSON", text), (b"BIN\0", bytes(made.data))))
    with pytest.raises(InputError, match=rf"plain.glb: .*{wanted}"):
        writer(asset, tmp_path / "m.glb", parameters={"uncompress": uncompress})


def test_extensions_that_are_no_list_are_left_out_of_a_plain_copy(tmp_path):
    made = quad()
    made.json["extensionsUsed"] = 3
    source = made.save(tmp_path / "plain.glb")
    assert "extensionsUsed" in mark(source, tmp_path / "marked.glb")
    assert "extensionsUsed" not in mark(source, tmp_path / "marked.glb", uncompress=True)


def sparse(made: GltfFile, accessor: int, indices: list[int], values: np.ndarray) -> None:
    made.json["accessors"][accessor]["sparse"] = {
        "count": len(indices),
        "indices": {
            "bufferView": made.view(np.array(indices, "<u2").tobytes()),
            "componentType": 5123,
        },
        "values": {"bufferView": made.view(np.asarray(values, "<f4").tobytes())},
    }


@pytest.mark.parametrize("uncompress", [False, True])
def test_sparse_positions_are_written_where_they_are_listed(tmp_path, uncompress):
    made = quad()
    sparse(made, 0, [1, 3], QUAD[[1, 3]] + 1)
    source = made.save(tmp_path / "plain.glb")
    written = mark(source, tmp_path / "marked.glb", uncompress=uncompress)["accessors"][0]
    assert ("sparse" in written) is not uncompress
    assert bounds(written) == [[0.5, 0.25, 1], [2.5, 2.25, 2]]


def test_sparse_positions_over_nothing_are_written_where_all_are_listed(tmp_path):
    made = quad()
    sparse(made, 0, [0, 1, 2, 3], QUAD)
    del made.json["accessors"][0]["bufferView"]
    written = mark(made.save(tmp_path / "plain.glb"), tmp_path / "marked.glb")
    assert "bufferView" not in written["accessors"][0]
