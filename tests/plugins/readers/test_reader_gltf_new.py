"""New glTF files of the frames of any source, and that they come back as they were."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from gltf_files import GltfFile, quad
from meshmark.errors import OutputError, UsageError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.topology import Topology
from meshmark.sources.reading import read
from meshmark.sources.writing import read_back, write
from meshmark.testing.meshes import icosphere
from meshmark_plugins.readers.gltf.container import read_container
from meshmark_plugins.readers.gltf.reader import GltfReader
from usd_stages import cube, write_text

V, F = icosphere(1)


def wave(prim: str, times: list[float], size: float = 1.0) -> MeshAnimation:
    """Return a ball that changes its shape from frame to frame."""
    rng = np.random.default_rng(7)
    points = size * (V + rng.normal(0, 0.1, (len(times), *V.shape)))
    return MeshAnimation.from_arrays(points, F, times=np.array(times), prim=prim)


def written(tmp_path, *meshes: MeshAnimation, fps: float = 24.0, name: str = "new.glb") -> Asset:
    asset = Asset(source="somewhere", meshes=meshes, reader="other", fps=fps)
    GltfReader().write_new(asset, tmp_path / name)
    return GltfReader().read(str(tmp_path / name))


@pytest.mark.parametrize("name", ["new.glb", "a new.gltf"])
@pytest.mark.parametrize("fps", [12.0, 23.976, 24.0, 60.0])
@pytest.mark.parametrize(
    "times", [[1, 2, 3, 4], [0, 5, 6, 20], [-7.5, -7, 3], [1000.25, 1001.25], [99_000, 99_001]]
)
def test_every_frame_comes_back_at_its_time(tmp_path, name, fps, times):
    mesh = wave("/A/B", times)
    found = written(tmp_path, mesh, fps=fps, name=name)
    assert found.fps == fps
    assert found.meshes[0].prim == "/A/B"
    np.testing.assert_array_equal(found.meshes[0].times, times)
    for one, two in zip(mesh, found.meshes[0], strict=True):
        np.testing.assert_allclose(two.points, one.points, rtol=0, atol=3e-7)
        np.testing.assert_array_equal(two.faces, one.faces)


def test_meshes_keep_their_own_frames_and_their_places(tmp_path):
    still = MeshAnimation.from_arrays(V, F, times=np.array([np.nan]), prim="/A")
    parts = [wave("/A/one", [1, 2, 3]), still, wave("/A/one/two", [2, 4]), wave("/B/one", [5])]
    found = written(tmp_path, *parts)
    assert {mesh.prim: len(mesh) for mesh in found.meshes} == {
        "/A": 1,
        "/A/one": 3,
        "/A/one/two": 2,
        "/B/one": 1,
    }
    assert np.isnan(found.mesh("/A").times).all()
    # A single frame has no time.
    assert np.isnan(found.mesh("/B/one").times).all()


def test_names_that_paths_have_otherwise_are_told(tmp_path):
    names = ["/", "left arm", "left_arm", "/x/left arm"]
    asset = Asset("somewhere", tuple(wave(name, [1, 2]) for name in names), reader="other")
    output = tmp_path / "new.glb"
    GltfReader().write_new(asset, output)
    told = GltfReader().written_names(asset)
    assert told == dict(
        zip(names, ["/Mesh", "/left_arm", "/left_arm_2", "/x/left_arm"], strict=True)
    )
    assert {mesh.prim for mesh in GltfReader().read(str(output)).meshes} == set(told.values())


def test_without_what_is_told_of_them_keys_are_read_as_those_of_others(tmp_path):
    written(tmp_path, mesh := wave("/A", [0, 1, 2, 3]), name="new.gltf")
    place = tmp_path / "new.gltf"
    document = json.loads(place.read_text())
    plain = document["meshes"][0]["extras"]
    nasty = [None, [], "x", {}, plain | {"timeCodes": [0, 1, 2]}, plain | {"timeCodes": "0123"}]
    nasty += [plain | {"timeCodes": [0, 1, 2, x]} for x in (2, -1, "x", None, 4, 1e300, True)]
    nasty += [plain | {"timeCodesPerSecond": x} for x in (0, -1, "x", 25, 1e300)]
    for extras in nasty:
        document["meshes"][0]["extras"] = extras
        place.write_text(json.dumps(document))
        [found] = GltfReader().read(str(place)).meshes
        np.testing.assert_array_equal(found.times, [0, 1, 2, 3])
        np.testing.assert_allclose(found[2].points, mesh[2].points, atol=3e-7)
    [asked] = GltfReader(fps=48).read(str(place)).meshes
    assert len(asked) == 7
    np.testing.assert_allclose(asked[3].points, (mesh[1].points + mesh[2].points) / 2, atol=3e-7)


def test_a_step_begins_with_the_frame_of_its_key(tmp_path):
    made: GltfFile = quad()
    times = np.arange(100) / 24
    moves = np.outer(np.arange(100), [1, 0, 0])
    made.animate(0, "translation", times, moves, interpolation="STEP")
    [mesh] = GltfReader().read(made.save(tmp_path / "step.glb")).meshes
    np.testing.assert_array_equal([frame.points[0, 0] for frame in mesh], np.arange(100))


def test_what_cannot_be_written_is_refused(tmp_path):
    pieces = [
        Frame(1.0, V, Topology.from_triangles(F, len(V))),
        Frame(2.0, V, Topology.from_triangles(F[1:], len(V))),
    ]
    with pytest.raises(UsageError, match="/A: its faces change over time"):
        written(tmp_path, MeshAnimation.from_frames(pieces, prim="/A"))
    far = wave("/C", [1, 2]).map(lambda frame: frame.moved(frame.points * 1e39))
    with pytest.raises(OutputError, match=r"/C: .*beyond the range"):
        written(tmp_path, far)
    long = replace(wave("/D", [1]), times=np.arange(40_000.0))
    with pytest.raises(OutputError, match=r"would have 6 GB; glTF holds 4 GB"):
        written(tmp_path, long)
    assert list(tmp_path.iterdir()) == []


def test_a_stage_is_marked_into_a_new_file(tmp_path):
    original = read(write_text(tmp_path / "s.usda", cube("b") + cube("a")))
    moved = original.meshes[0].map(lambda frame: frame.moved(frame.points + 1))
    output = tmp_path / "o.glb"
    write(replace(original, meshes=(moved,)), original, output)
    back = read_back(original, output, ["/a", "/b"])
    assert [mesh.prim for mesh in back.meshes] == ["/a", "/b"]
    np.testing.assert_array_equal(back.meshes[0][0].points, original.mesh("/a")[0].points)
    np.testing.assert_array_equal(back.meshes[1][0].points, original.mesh("/b")[0].points + 1)
    assert read_container(output).binary is not None
