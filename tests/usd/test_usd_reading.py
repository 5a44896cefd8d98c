"""Stages in: every kind of mesh prim, world space, and every kind of bad input."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, UsdUtils

from meshmark.mesh.checks import check
from meshmark.usd.opening import KEPT_OPEN, open_stage, stage_files
from meshmark.usd.reading import read_stage
from usd_stages import CUBE_INDICES, CUBE_POINTS, array, cube, read_one, sampled, write_text


def test_polygons_are_kept_and_fanned(tmp_path: Path) -> None:
    mesh = read_one(write_text(tmp_path / "cube.usda", cube()))
    assert mesh.prim == "/cube"
    assert len(mesh) == 1
    assert np.isnan(mesh.times).all()
    frame = mesh[0]
    np.testing.assert_array_equal(frame.points, CUBE_POINTS)
    assert frame.points.dtype == np.float64
    np.testing.assert_array_equal(frame.topology.indices, CUBE_INDICES)
    assert frame.faces.shape == (12, 3)
    # Outward faces: by the divergence theorem the signed volume is that of the cube.
    a, b, c = (frame.points[frame.faces[:, k]] for k in range(3))
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(1.0)


def test_what_changed_on_disk_is_read_again_whoever_holds_the_old(tmp_path: Path) -> None:
    """A modelling program may still have a layer open that it, or another, has exported anew."""
    source = write_text(tmp_path / "cube.usda", cube())
    held = Sdf.Layer.FindOrOpen(source)
    np.testing.assert_array_equal(read_one(source)[0].points, CUBE_POINTS)
    write_text(tmp_path / "cube.usda", cube(points=f"point3f[] points = {array(CUBE_POINTS + 1)}"))
    np.testing.assert_array_equal(read_one(source)[0].points, CUBE_POINTS + 1)
    # What somebody is editing is theirs.
    held.comment = "not saved"
    write_text(tmp_path / "cube.usda", cube(points=f"point3f[] points = {array(CUBE_POINTS + 2)}"))
    read_one(source)
    assert held.comment == "not saved"


def test_stage_metadata_is_on_the_asset(tmp_path: Path) -> None:
    source = write_text(
        tmp_path / "cube.usda", cube(), 'upAxis = "Z"\nmetersPerUnit = 0.5\nframesPerSecond = 30'
    )
    asset = read_stage(source)
    assert (asset.source, asset.reader) == (source, "usd")
    assert (asset.up_axis, asset.meters_per_unit, asset.fps) == ("Z", 0.5, 30.0)
    assert asset.notes == ()


def test_points_are_in_world_space_at_their_own_times(tmp_path: Path) -> None:
    body = f"""
    def Xform "outer"
    {{
        double3 xformOp:translate.timeSamples = {{ 1: (0, 0, 0), 3: (20, 0, 0) }}
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def Xform "inner"
        {{
            double3 xformOp:rotateXYZ = (0, 0, 90)
            double3 xformOp:scale = (2, 2, 2)
            uniform token[] xformOpOrder = ["xformOp:rotateXYZ", "xformOp:scale"]
            {cube(points=sampled({1: CUBE_POINTS, 2.5: CUBE_POINTS}))}
        }}
    }}
    """
    mesh = read_one(write_text(tmp_path / "moving.usda", body))
    np.testing.assert_array_equal(mesh.times, [1.0, 2.5])
    turned = 2 * np.stack([-CUBE_POINTS[:, 1], CUBE_POINTS[:, 0], CUBE_POINTS[:, 2]], axis=1)
    np.testing.assert_allclose(mesh[0].points, turned, atol=1e-12)
    np.testing.assert_allclose(mesh[1].points, turned + np.array([15, 0, 0]), atol=1e-12)


def test_rigid_motion_alone_is_one_frame(tmp_path: Path) -> None:
    body = f"""
    def Xform "outer"
    {{
        double3 xformOp:translate.timeSamples = {{ 1: (5, 0, 0), 3: (20, 0, 0) }}
        uniform token[] xformOpOrder = ["xformOp:translate"]
        {cube()}
    }}
    """
    mesh = read_one(write_text(tmp_path / "rigid.usda", body))
    assert np.isnan(mesh.times).all()
    np.testing.assert_allclose(mesh[0].points, CUBE_POINTS + np.array([5, 0, 0]))


@pytest.mark.parametrize(("left_handed", "mirrored"), [(True, False), (False, True), (True, True)])
def test_handedness_and_mirrors(tmp_path: Path, left_handed: bool, mirrored: bool) -> None:
    # Left-handed text lists the same cube inside out; a mirroring transform turns it once more.
    body = f"""
    def Xform "mirror"
    {{
        double3 xformOp:scale = ({-1 if mirrored else 1}, 1, 1)
        uniform token[] xformOpOrder = ["xformOp:scale"]
        {cube(more='uniform token orientation = "leftHanded"' if left_handed else "")}
    }}
    """
    frame = read_one(write_text(tmp_path / "mirror.usda", body))[0]
    a, b, c = (frame.points[frame.faces[:, k]] for k in range(3))
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    # Handedness flips the sign by definition; a mirror does not turn a mesh inside out.
    assert volume == pytest.approx(-1.0 if left_handed else 1.0)
    first_corners = frame.topology.indices.reshape(-1, 4)[:, 0]
    np.testing.assert_array_equal(first_corners, CUBE_INDICES[::4])


def test_topology_is_one_object_while_it_is_constant(tmp_path: Path) -> None:
    frames = {1: CUBE_POINTS, 2: CUBE_POINTS + 1, 3: CUBE_POINTS + 2}
    mesh = read_one(write_text(tmp_path / "a.usda", cube(points=sampled(frames))))
    assert mesh.constant_topology
    assert mesh[0].topology is mesh[2].topology
    assert mesh[0].faces is mesh[1].faces


def test_faces_sampled_but_equal_are_constant(tmp_path: Path) -> None:
    same = f"1: {CUBE_INDICES}, 2: {CUBE_INDICES}"
    body = cube(points=sampled({1: CUBE_POINTS, 2: CUBE_POINTS + 1}))
    body = body.replace(
        f"faceVertexIndices = {CUBE_INDICES}", f"faceVertexIndices.timeSamples = {{ {same} }}"
    )
    assert read_one(write_text(tmp_path / "a.usda", body)).constant_topology


def test_frames_pickle_and_read_alike_elsewhere(tmp_path: Path) -> None:
    source = write_text(
        tmp_path / "a.usda", cube(points=sampled({1: CUBE_POINTS, 7: -CUBE_POINTS}))
    )
    mesh = read_one(source)
    data = pickle.dumps(mesh)
    assert len(data) < 2000
    (tmp_path / "mesh.pickle").write_bytes(data)
    script = "import pickle, sys; print(pickle.load(open(sys.argv[1], 'rb'))[1].points.sum())"
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "mesh.pickle")],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert float(done.stdout) == mesh[1].points.sum() == -12.0


def test_a_changed_file_is_read_anew(tmp_path: Path) -> None:
    path = tmp_path / "a.usda"
    assert read_one(write_text(path, cube()))[0].points.max() == 1
    text = path.read_text().replace("(1, 1, 1)", "(1, 1, 9)")
    path.write_text(text)
    os.utime(path, ns=(1, 1))
    assert read_one(str(path))[0].points.max() == 9


def test_few_stages_are_kept_open(tmp_path: Path) -> None:
    sources = [write_text(tmp_path / f"{k}.usda", cube()) for k in range(KEPT_OPEN + 1)]
    first = open_stage(sources[0])
    assert open_stage(sources[0]) is first
    for source in sources[1:]:
        open_stage(source)
    assert open_stage(sources[0]) is not first


def test_purposes(tmp_path: Path) -> None:
    body = "".join(
        cube(name, more=f'uniform token purpose = "{name}"')
        for name in ("default", "render", "proxy", "guide")
    )
    source = write_text(tmp_path / "purposes.usda", body)
    asset = read_stage(source)
    assert [mesh.prim for mesh in asset.meshes] == ["/default", "/render", "/proxy"]
    assert asset.notes == ("/guide: left out: purpose guide",)
    assert [mesh.prim for mesh in read_stage(source, ["/guide"]).meshes] == ["/guide"]


def test_what_the_stage_does_not_show_is_not_read(tmp_path: Path) -> None:
    body = cube("shown") + cube("hidden", kind="over") + cube("abstract", kind="class")
    body += cube("dead").replace('"dead"', '"dead" ( active = false )')
    assert read_one(write_text(tmp_path / "a.usda", body)).prim == "/shown"


def test_instances_are_read_with_a_note(tmp_path: Path) -> None:
    write_text(tmp_path / "model.usda", f'def Xform "M"\n{{{cube()}}}', 'defaultPrim = "M"')
    body = """
    def "plain" (references = @model.usda@)
    {
    }
    def "copy" (references = @model.usda@
        instanceable = true)
    {
        double3 xformOp:translate = (9, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    """
    plain, copy = read_stage(write_text(tmp_path / "scene.usda", body)).meshes
    assert (plain.prim, plain.notes) == ("/plain/cube", ())
    assert copy.prim == "/copy/cube"
    assert "instance" in copy.notes[0]
    np.testing.assert_allclose(copy[0].points, plain[0].points + np.array([9, 0, 0]))


def test_package(tmp_path: Path) -> None:
    write_text(tmp_path / "cube.usda", cube())
    package = tmp_path / "cube.usdz"
    assert UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(tmp_path / "cube.usda")), str(package))
    np.testing.assert_array_equal(read_one(str(package))[0].points, CUBE_POINTS)
    assert stage_files(str(package)) == [package.resolve()]


def test_stage_files(tmp_path: Path) -> None:
    write_text(tmp_path / "z.usda", f'def Xform "M"\n{{{cube()}}}', 'defaultPrim = "M"')
    write_text(tmp_path / "sub" / "b.usda", 'over "a"\n{\n}')
    body = 'def "a" (payload = @z.usda@)\n{\n}'
    source = write_text(tmp_path / "scene.usda", body, "subLayers = [@sub/b.usda@]")
    names = [str(path.relative_to(tmp_path.resolve())) for path in stage_files(source)]
    assert names == ["scene.usda", "sub/b.usda", "z.usda"]


def test_a_missing_layer_is_a_note(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    source = write_text(tmp_path / "a.usda", cube(), "subLayers = [@gone.usda@]")
    (note,) = read_stage(source).notes
    assert "gone.usda" in note
    assert "0x" not in note
    assert capfd.readouterr().err == ""


# Real input --------------------------------------------------------------------------------------


def test_horse(data_folder: Path) -> None:
    mesh = read_one(str(data_folder / "horse-gallop.usdc"))
    assert (mesh.prim, len(mesh), mesh.constant_topology) == ("/Horse/Geom/body", 48, True)
    assert mesh[0].points.shape == (8431, 3)
    assert mesh[0].faces.shape == (16843, 3)
    check(mesh)
    # One cycle played twice.
    np.testing.assert_array_equal(mesh[3].points, mesh[27].points)


def test_varying_topology(data_folder: Path) -> None:
    mesh = read_one(str(data_folder / "usd" / "varying-topology.usda"))
    assert not mesh.constant_topology
    assert [frame.topology.counts.tolist() for frame in mesh] == [[4], [4, 3], [3]]
    assert [len(frame.points) for frame in mesh] == [4, 7, 3]


def test_assembled_stage(data_folder: Path) -> None:
    source = str(data_folder / "usd" / "ballset" / "StandaloneScene" / "top_layer.usda")
    asset = read_stage(source)
    assert len(asset.meshes) == 35
    first, second = asset.meshes[0][0], asset.meshes[1][0]
    np.testing.assert_allclose(
        first.points.mean(0) - second.points.mean(0), [-4.949, 0, 2.8575], 1e-3, 1e-6
    )
    names = {path.name for path in stage_files(source)}
    assert names > {"top_layer.usda", "Ball.usd", "Ball_payload.usd", "Ball.maya.usd"}


@pytest.mark.parametrize(
    ("name", "n_points"), [("CesiumMan.usdz", 3273), ("skel-human.usda", 2240)]
)
def test_rigged(data_folder: Path, name: str, n_points: int) -> None:
    mesh = read_one(str(data_folder / "usd" / name))
    (note,) = mesh.notes
    assert note.startswith("rigged: posed by /")
    assert len(mesh) in (48, 101)
    assert mesh[0].points.shape == (n_points, 3)
    assert (mesh[0].points != mesh[len(mesh) // 2].points).any(axis=1).all()
