"""What is compressed in glTF files, decoded by optional packages."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from gltf_files import GltfFile, ball, quad, skinned_quad
from meshmark.errors import InputError
from meshmark_plugins.readers.gltf.reader import GltfReader


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
