"""Compressed glTF files, compressed again when they are written back, or written plainly."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from gltf_files import QUAD, QUAD_FACES, GltfFile, ball, draco_quad
from gltf_writing import bounds, mark
from meshmark.errors import InputError, UsageError
from meshmark.sources.writing import writer
from meshmark_plugins.readers.gltf.container import read_container
from meshmark_plugins.readers.gltf.reader import GltfReader

MESHOPT = "EXT_meshopt_compression"


def test_a_primitive_of_draco_may_name_no_faces_but_none_that_are_not_there(tmp_path):
    made = draco_quad()
    primitive = made.json["meshes"][0]["primitives"][0]
    primitive["indices"] = 7
    source = made.save(tmp_path / "plain.glb")
    asset = GltfReader().read(source)
    with pytest.raises(InputError, match=r"primitives\[0\].indices is 7, but there are 2"):
        writer(asset, tmp_path / "marked.glb", parameters={"uncompress": True})
    del primitive["indices"]
    mark(made.save(tmp_path / "plain.glb"), tmp_path / "marked.glb", uncompress=True)


def packed_ball(extension: str = MESHOPT, *, fallback: bool = False) -> GltfFile:
    """Compress the positions of a ball, between other data."""
    meshopt = pytest.importorskip("meshopt", reason="meshopt, an optional library, is absent")
    made = ball(2, bending=False)
    position = made.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
    view = made.json["bufferViews"][made.json["accessors"][position]["bufferView"]]
    begin, length = view["byteOffset"], view["byteLength"]
    rows = np.frombuffer(bytes(made.data[begin : begin + length]), np.uint8).reshape(-1, 12)
    where = made.json["bufferViews"][made.view(meshopt.encode_gltf_buffer(rows, "ATTRIBUTES"))]
    made.json["bufferViews"].pop()
    told = {"count": len(rows), "byteStride": 12, "mode": "ATTRIBUTES"}
    view["extensions"] = {extension: {**where, **told}}
    made.json["extensionsUsed"] = [extension]
    behind = made.add("nodes", mesh=made.mesh(made.primitive(QUAD, QUAD_FACES)), name="behind")
    assert behind
    if not fallback:
        view |= {"buffer": 1, "byteOffset": 0}
        made.json["buffers"] = [
            {"byteLength": len(made.data)},
            {"byteLength": length, "extensions": {extension: {"fallback": True}}},
        ]
    return made


@pytest.mark.parametrize("fallback", [False, True])
@pytest.mark.parametrize("extension", [MESHOPT, "KHR_meshopt_compression"])
def test_compressed_views_are_compressed_again(tmp_path, extension, fallback):
    made = packed_ball(extension, fallback=fallback)
    source = made.save(tmp_path / "plain.glb")
    plain = GltfReader().read(source)
    # Noise needs more room than the ball.
    writer(plain, tmp_path / "marked.glb")(marked := noisy(plain))
    found = GltfReader().read(str(tmp_path / "marked.glb"))
    for mesh, other in zip(marked.meshes, found.meshes, strict=True):
        np.testing.assert_allclose(other[0].points, mesh[0].points, atol=1e-6)
    before, after = (
        read_container(tmp_path / name).root.members for name in ("plain.glb", "marked.glb")
    )
    position = before["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
    view = after["accessors"][position]["bufferView"]
    packed = after["bufferViews"][view]["extensions"][extension]
    assert packed["byteLength"] > before["bufferViews"][view]["extensions"][extension]["byteLength"]
    assert after["buffers"][0]["byteLength"] > before["buffers"][0]["byteLength"]
    if fallback:
        view = {**after["bufferViews"][view]}
        data = read_container(tmp_path / "marked.glb").binary[view["byteOffset"] :]
        points = np.frombuffer(data, "<f4", view["byteLength"] // 4).reshape(-1, 3)
        assert bounds(after["accessors"][position]) == [
            points.min(0).tolist(),
            points.max(0).tolist(),
        ]


def test_what_cannot_be_compressed_again_is_refused_before_any_work(tmp_path, monkeypatch):
    made = packed_ball(fallback=True)
    source = made.save(tmp_path / "plain.glb")
    asset = GltfReader().read(source)
    [view] = [view for view in made.json["bufferViews"] if "extensions" in view]
    view["extensions"]["KHR_meshopt_compression"] = view["extensions"][MESHOPT]
    made.save(tmp_path / "plain.glb")
    with pytest.raises(UsageError, match="is not compressed as positions are"):
        writer(asset, tmp_path / "marked.glb")
    del view["extensions"]["KHR_meshopt_compression"]
    made.save(tmp_path / "plain.glb")
    monkeypatch.setitem(sys.modules, "meshopt", None)
    with pytest.raises(InputError, match=r"the package meshopt is not installed: pip"):
        writer(asset, tmp_path / "marked.glb")


def noisy(asset):
    """Move points at rest by noise, so that they come back as they are."""
    rng = np.random.default_rng(0)
    meshes = []
    for mesh in asset.meshes:
        frames = mesh.source
        V = frames.geometry.vertices
        points = (V.points + rng.normal(0, 0.01, V.points.shape)).astype(np.float32)
        geometry = replace(frames.geometry, vertices=replace(V, points=points))
        meshes.append(replace(mesh, source=replace(frames, geometry=geometry)))
    return replace(asset, meshes=tuple(meshes))


def test_compressed_views_that_shrink_leave_nothing_behind(tmp_path):
    made = packed_ball()
    plain = GltfReader().read(made.save(tmp_path / "plain.glb"))
    writer(plain, tmp_path / "noisy.glb")(noisy(plain))
    again = GltfReader().read(str(tmp_path / "noisy.glb"))
    flat = replace(
        again,
        meshes=tuple(
            mesh.map(lambda frame: frame.moved(0 * frame.points)) for mesh in again.meshes
        ),
    )
    writer(again, tmp_path / "flat.glb")(flat)
    before, after = (read_container(tmp_path / name) for name in ("noisy.glb", "flat.glb"))
    assert after.root.members["buffers"] == before.root.members["buffers"]
    GltfReader().read(str(tmp_path / "flat.glb"))


def test_compressed_views_are_written_plainly(tmp_path):
    source = packed_ball().save(tmp_path / "plain.glb")
    plain = GltfReader(uncompress=True).read(source)
    writer(plain, tmp_path / "marked.glb", parameters={"uncompress": True})(marked := noisy(plain))
    written = read_container(tmp_path / "marked.glb").root.members
    assert "extensions" not in json.dumps(written)
    assert len(written["buffers"]) == 1
    found = GltfReader().read(str(tmp_path / "marked.glb"))
    for mesh, other in zip(marked.meshes, found.meshes, strict=True):
        np.testing.assert_allclose(other[0].points, mesh[0].points, atol=1e-6)


def test_what_draco_compressed_is_written_plainly(tmp_path):
    made = draco_quad()
    source = made.save(tmp_path / "plain.glb")
    plain = GltfReader().read(source)
    written = mark(source, tmp_path / "marked.glb", uncompress=True)
    assert "extensions" not in json.dumps(written)
    [found] = GltfReader().read(str(tmp_path / "marked.glb")).meshes
    np.testing.assert_array_equal(found[0].faces, plain.meshes[0][0].faces)
