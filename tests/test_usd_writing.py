"""Override layers and new stages out: nothing but moved points, every frame, bit by bit."""

from __future__ import annotations

import hashlib
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pxr import Sdf, Usd, UsdGeom, UsdUtils
from usd_stages import (
    CUBE_COUNTS,
    CUBE_INDICES,
    CUBE_POINTS,
    cube,
    moved,
    points_at,
    sampled,
    write_text,
)

from meshmark.animation import Asset, Frame, InMemoryFrames, MeshAnimation, Topology
from meshmark.errors import MeshmarkError, OutputError, UsageError
from meshmark.usd import layers
from meshmark.usd.parts import palette, write_parts
from meshmark.usd.reading import read_stage
from meshmark.usd.stages import write_stage
from meshmark.usd.writing import write_override

FRAMES = {1: CUBE_POINTS, 2: CUBE_POINTS + 1, 4.5: CUBE_POINTS * 2}


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def specs(layer: Sdf.Layer) -> list[Sdf.Path]:
    paths: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    return [path for path in paths if path != Sdf.Path.absoluteRootPath]


def assert_only_points(layer: Sdf.Layer) -> None:
    """Only `over` specs, with nothing but points and extent."""
    for path in specs(layer):
        if path.IsPrimPath():
            prim = layer.GetPrimAtPath(path)
            assert prim.specifier == Sdf.SpecifierOver
            assert set(prim.ListInfoKeys()) <= {"specifier"}
        else:
            assert path.name in ("points", "extent")


def assert_same_but_points(source: str, output: Path) -> None:
    """Every attribute but points and extent has the same values, and the stage the same frame."""
    before, after = Usd.Stage.Open(source), Usd.Stage.Open(str(output))
    for name in (
        "GetStartTimeCode",
        "GetEndTimeCode",
        "GetTimeCodesPerSecond",
        "GetFramesPerSecond",
    ):
        assert getattr(before, name)() == getattr(after, name)()
    assert UsdGeom.GetStageUpAxis(before) == UsdGeom.GetStageUpAxis(after)
    assert UsdGeom.GetStageMetersPerUnit(before) == UsdGeom.GetStageMetersPerUnit(after)
    assert before.GetDefaultPrim().GetPath() == after.GetDefaultPrim().GetPath()
    paths = [prim.GetPath() for prim in before.TraverseAll()]
    assert paths == [prim.GetPath() for prim in after.TraverseAll()]
    for path in paths:
        for attribute in before.GetPrimAtPath(path).GetAuthoredAttributes():
            name = attribute.GetName()
            if name not in ("points", "extent"):
                other = after.GetPrimAtPath(path).GetAttribute(name)
                assert attribute.GetTimeSamples() == other.GetTimeSamples()
                assert attribute.Get() == other.Get()


@pytest.mark.parametrize("suffix", [".usd", ".usda", ".usdc"])
def test_sampled_points(tmp_path: Path, suffix: str) -> None:
    source = write_text(
        tmp_path / "a.usda",
        f'def Xform "root"\n{{{cube(points=sampled(FRAMES))}}}',
        'defaultPrim = "root"\nupAxis = "Z"\nmetersPerUnit = 1\nframesPerSecond = 25\n'
        "startTimeCode = 1\nendTimeCode = 5",
    )
    original = read_stage(source)
    marked = moved(original)
    output = tmp_path / f"marked{suffix}"
    before = digest(Path(source))
    write_override(original, marked, output)
    assert digest(Path(source)) == before
    assert output.read_bytes().startswith(b"#usda" if suffix == ".usda" else b"PXR-USDC")
    layer = Sdf.Layer.FindOrOpen(str(output))
    assert list(layer.subLayerPaths) == ["./a.usda"]
    assert not layer.pseudoRoot.HasInfo("timeCodesPerSecond")
    assert_only_points(layer)
    assert_same_but_points(source, output)
    assert layer.ListTimeSamplesForPath("/root/cube.points") == [1, 2, 4.5]
    assert layer.GetAttributeAtPath("/root/cube.points").default is None
    stage = Usd.Stage.Open(str(output))
    for index, (time, points) in enumerate(FRAMES.items()):
        written = points_at(stage, "/root/cube", time)
        np.testing.assert_array_equal(written[::2], points[::2])
        assert (written[1::2] != points[1::2]).all()
        np.testing.assert_array_equal(written, marked.meshes[0][index].points.astype(np.float32))
        box = stage.GetPrimAtPath("/root/cube").GetAttribute("extent").Get(time)
        np.testing.assert_array_equal(box, [written.min(0), written.max(0)])
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


def test_default_points_only(tmp_path: Path) -> None:
    source = write_text(tmp_path / "a.usda", cube())
    original = read_stage(source)
    write_override(original, moved(original), tmp_path / "o.usda")
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "o.usda"))
    assert layer.GetNumTimeSamplesForPath("/cube.points") == 0
    written = np.array(layer.GetAttributeAtPath("/cube.points").default)
    np.testing.assert_array_equal(written[::2], CUBE_POINTS[::2])
    assert (written[1::2] != CUBE_POINTS[1::2]).all()


def test_frames_that_were_not_marked_are_authored_as_they_are(tmp_path: Path) -> None:
    source = write_text(tmp_path / "a.usda", cube(points=sampled(FRAMES)))
    original = read_stage(source)
    marked = moved(original)
    marked = replace(marked, meshes=(marked.meshes[0].select([1]),))
    write_override(original, marked, tmp_path / "o.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "o.usdc"))
    for time, points in FRAMES.items():
        same = np.array_equal(points_at(stage, "/cube", time), points)
        assert same == (time != 2)


def test_only_the_marked_meshes_are_authored(tmp_path: Path) -> None:
    source = write_text(tmp_path / "a.usda", cube("a") + cube("b"))
    original = read_stage(source)
    write_override(original, moved(read_stage(source, ["/b"])), tmp_path / "o.usda")
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "o.usda"))
    assert [prim.name for prim in layer.rootPrims] == ["b"]


@settings(max_examples=20, deadline=None)
@given(
    angles=st.tuples(*[st.floats(-180, 180)] * 3),
    scale=st.tuples(*[st.floats(0.01, 100)] * 3),
    shift=st.tuples(*[st.floats(-1000, 1000)] * 3),
)
def test_moves_return_to_local_space(
    tmp_path_factory: pytest.TempPathFactory,
    angles: tuple[float, ...],
    scale: tuple[float, ...],
    shift: tuple[float, ...],
) -> None:
    folder = tmp_path_factory.mktemp("xform")
    body = f"""
    def Xform "x"
    {{
        double3 xformOp:translate = {shift}
        double3 xformOp:rotateXYZ = {angles}
        double3 xformOp:scale = {scale}
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"]
        {cube(points=sampled(FRAMES))}
    }}
    """
    original = read_stage(write_text(folder / "a.usda", body))
    step = np.zeros((8, 3))
    step[3] = [0.25, -0.5, 0.125]
    mesh = original.meshes[0].map(lambda frame: frame.moved(frame.points + step))
    write_override(original, replace(original, meshes=(mesh,)), folder / "o.usdc")
    stage = Usd.Stage.Open(str(folder / "o.usdc"))
    again = read_stage(str(folder / "o.usdc")).meshes[0]
    for index, (time, points) in enumerate(FRAMES.items()):
        local = points_at(stage, "/x/cube", time)
        still = np.arange(8) != 3
        np.testing.assert_array_equal(local[still], points[still])
        size = np.abs(local[3]).max() * max(scale)
        np.testing.assert_allclose(
            again[index].points[3], mesh[index].points[3], rtol=0, atol=4e-7 * size
        )


def test_a_prim_squeezed_flat_moves_where_it_can(tmp_path: Path) -> None:
    body = f"""
    def Xform "flat"
    {{
        double3 xformOp:scale = (2, 1, 0)
        uniform token[] xformOpOrder = ["xformOp:scale"]
        {cube()}
    }}
    """
    original = read_stage(write_text(tmp_path / "a.usda", body))
    mesh = original.meshes[0].map(lambda frame: frame.moved(frame.points + 0.5))
    write_override(original, replace(original, meshes=(mesh,)), tmp_path / "o.usda")
    written = points_at(Usd.Stage.Open(str(tmp_path / "o.usda")), "/flat/cube")
    np.testing.assert_allclose(written, CUBE_POINTS + np.array([0.25, 0.5, 0]), atol=1e-6)


def test_source_in_another_folder_with_another_clock(tmp_path: Path) -> None:
    source = write_text(
        tmp_path / "in" / "a.usda", cube(points=sampled(FRAMES)), "timeCodesPerSecond = 48"
    )
    original = read_stage(source)
    (tmp_path / "out").mkdir()
    output = tmp_path / "out" / "o.usda"
    write_override(original, moved(original), output)
    layer = Sdf.Layer.FindOrOpen(str(output))
    assert list(layer.subLayerPaths) == ["../in/a.usda"]
    # Were the clocks different, USD would scale the times of the source.
    assert_same_but_points(source, output)
    np.testing.assert_array_equal(read_stage(str(output)).meshes[0].times, [1, 2, 4.5])


def test_package_as_source(tmp_path: Path) -> None:
    write_text(tmp_path / "cube.usda", cube(points=sampled(FRAMES)), 'defaultPrim = "cube"')
    package = tmp_path / "cube.usdz"
    UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(tmp_path / "cube.usda")), str(package))
    (tmp_path / "cube.usda").unlink()
    original = read_stage(str(package))
    output = tmp_path / "o.usdc"
    write_override(original, moved(original), output)
    assert list(Sdf.Layer.FindOrOpen(str(output)).subLayerPaths) == ["./cube.usdz"]
    assert_same_but_points(str(package), output)


def test_value_clips_are_overridden(tmp_path: Path) -> None:
    first, second = CUBE_POINTS, CUBE_POINTS + 1
    for name, points in (("c1", first), ("c2", second)):
        write_text(tmp_path / f"{name}.usda", cube(points=sampled({1: points}), kind="over"))
    write_text(tmp_path / "manifest.usda", 'over "cube"\n{\npoint3f[] points\n}')
    shape = "\n".join(line for line in cube().splitlines() if "point3f" not in line)
    clips = """clips = {
            dictionary default = {
                asset[] assetPaths = [@c1.usda@, @c2.usda@]
                asset manifestAssetPath = @manifest.usda@
                string primPath = "/cube"
                double2[] active = [(1, 0), (2, 1)]
                double2[] times = [(1, 1), (2, 1)]
            }
        }"""
    body = shape.replace('Mesh "cube"', f'Mesh "cube" (\n{clips}\n)')
    original = read_stage(write_text(tmp_path / "a.usda", body))
    np.testing.assert_array_equal(original.meshes[0].times, [1, 2])
    np.testing.assert_array_equal(original.meshes[0][1].points, second)
    marked = moved(original)
    write_override(original, marked, tmp_path / "o.usda")
    again = read_stage(str(tmp_path / "o.usda")).meshes[0]
    for before, after in zip(marked.meshes[0], again, strict=True):
        np.testing.assert_array_equal(after.points, before.points.astype(np.float32))


def test_meshes_inside_instances_are_skipped(tmp_path: Path) -> None:
    write_text(tmp_path / "model.usda", f'def Xform "M"\n{{{cube()}}}', 'defaultPrim = "M"')
    copy = 'def "copy" (references = @model.usda@\n instanceable = true)\n{\n}\n'
    both = read_stage(write_text(tmp_path / "both.usda", cube() + copy))
    write_override(both, moved(both), tmp_path / "o.usda")
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "o.usda"))
    assert [prim.name for prim in layer.rootPrims] == ["cube"]
    alone = read_stage(write_text(tmp_path / "alone.usda", copy))
    with pytest.raises(OutputError, match="inside an instance"):
        write_override(alone, moved(alone), tmp_path / "none.usda")
    assert not (tmp_path / "none.usda").exists()


@pytest.mark.parametrize("batch", [1, 1000, layers.BATCH_BYTES])
def test_bytes_are_the_same_every_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, batch: int
) -> None:
    monkeypatch.setattr(layers, "BATCH_BYTES", batch)
    frames = {time: CUBE_POINTS + time for time in range(1, 60)}
    original = read_stage(write_text(tmp_path / "a.usda", cube(points=sampled(frames))))
    outputs = [tmp_path / name for name in ("x.usdc", "y.usdc")]
    for output in outputs:
        write_override(original, moved(original), output)
    assert digest(outputs[0]) == digest(outputs[1])
    again = read_stage(str(outputs[0])).meshes[0]
    for before, after in zip(moved(original).meshes[0], again, strict=True):
        np.testing.assert_array_equal(after.points, before.points.astype(np.float32))


# What must not be written ------------------------------------------------------------------------


def test_the_source_is_never_overwritten(tmp_path: Path) -> None:
    write_text(tmp_path / "base.usda", cube())
    source = write_text(tmp_path / "a.usda", "", "subLayers = [@base.usda@]")
    original = read_stage(source)
    (tmp_path / "link.usda").symlink_to(tmp_path / "base.usda")
    for name in ("a.usda", "base.usda", "link.usda"):
        before = digest(tmp_path / name)
        with pytest.raises(OutputError, match="part of the source"):
            write_override(original, moved(original), tmp_path / name)
        assert digest(tmp_path / name) == before


def broken(frame: Frame) -> Frame:
    if frame.time == 2:
        raise ZeroDivisionError
    return frame


def halved(frame: Frame) -> Frame:
    return frame.moved(frame.points[:4]) if frame.time == 2 else frame


def infinite(frame: Frame) -> Frame:
    return frame.moved(frame.points * np.inf) if frame.time == 2 else frame


@pytest.mark.parametrize(
    ("function", "error"),
    [(broken, ZeroDivisionError), (halved, UsageError), (infinite, OutputError)],
)
def test_nothing_half_written_is_left(
    tmp_path: Path, function: type[Frame], error: type[Exception]
) -> None:
    original = read_stage(write_text(tmp_path / "a.usda", cube(points=sampled(FRAMES))))
    marked = replace(original, meshes=(original.meshes[0].map(function),))
    output = tmp_path / "o.usdc"
    output.write_text("what was there before")
    with pytest.raises(error) as caught:
        write_override(original, marked, output)
    assert output.read_text() == "what was there before"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.usda", "o.usdc"]
    if isinstance(caught.value, MeshmarkError):
        assert (caught.value.prim, caught.value.time) == ("/cube", 2)


def test_impossible_places(tmp_path: Path) -> None:
    original = read_stage(write_text(tmp_path / "a.usda", cube()))
    with pytest.raises(OutputError, match="No such file"):
        write_override(original, moved(original), tmp_path / "none" / "o.usda")
    with pytest.raises(UsageError, match="must end in"):
        write_override(original, moved(original), tmp_path / "o.abc")
    (tmp_path / "folder.usda").mkdir()
    with pytest.raises(OutputError, match="cannot be written"):
        write_override(original, moved(original), tmp_path / "folder.usda")


def test_frames_and_prims_the_source_does_not_have(tmp_path: Path) -> None:
    original = read_stage(write_text(tmp_path / "a.usda", cube(points=sampled(FRAMES))))
    mesh = original.meshes[0]
    late = replace(original, meshes=(replace(mesh, times=mesh.times + 0.25),))
    with pytest.raises(UsageError, match="no points at time"):
        write_override(original, late, tmp_path / "o.usda")
    lost = replace(original, meshes=(replace(mesh, prim="/none"),))
    with pytest.raises(UsageError, match="no such prim"):
        write_override(original, lost, tmp_path / "o.usda")


# New stages --------------------------------------------------------------------------------------


def animation(n_frames: int, *, varying: bool = False, prim: str = "/") -> MeshAnimation:
    cube_faces = Topology(np.array(CUBE_COUNTS), np.array(CUBE_INDICES), 8)
    open_box = Topology(np.array(CUBE_COUNTS[:5]), np.array(CUBE_INDICES[:20]), 8)
    frames = [
        Frame(1.0 + k, CUBE_POINTS + k, open_box if varying and k % 2 else cube_faces)
        for k in range(n_frames)
    ]
    return MeshAnimation.from_frames(frames, prim=prim)


@pytest.mark.parametrize("varying", [False, True])
@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
def test_new_stage_reads_back(tmp_path: Path, varying: bool, suffix: str) -> None:
    meshes = (animation(3, varying=varying, prim="/a/b"), animation(2, prim="/a/c"))
    asset = Asset("x", meshes, "test", up_axis="Z", meters_per_unit=1.0, fps=30.0)
    output = tmp_path / f"new{suffix}"
    write_stage(asset, output)
    again = read_stage(str(output))
    assert (again.up_axis, again.meters_per_unit, again.fps) == ("Z", 1.0, 30.0)
    assert [mesh.prim for mesh in again.meshes] == ["/a/b", "/a/c"]
    assert again.meshes[0].constant_topology is not varying
    for mesh, read in zip(meshes, again.meshes, strict=True):
        for before, after in zip(mesh, read, strict=True):
            assert before.time == after.time
            assert before.topology.same_as(after.topology)
            np.testing.assert_array_equal(before.points, after.points)
    stage = Usd.Stage.Open(str(output))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1, 3)
    assert stage.GetDefaultPrim().GetPath() == "/a"
    assert stage.GetPrimAtPath("/a").GetTypeName() == "Xform"
    mesh = UsdGeom.Mesh.Get(stage, "/a/b")
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
    np.testing.assert_array_equal(mesh.GetExtentAttr().Get(2), [[1, 1, 1], [2, 2, 2]])


def test_names_usd_does_not_allow(tmp_path: Path) -> None:
    frame = animation(1)[0]
    still = InMemoryFrames((replace(frame, time=np.nan),))
    prims = ("/", "/node 1/mesh", "/node-1/mesh", "/node 1")
    meshes = tuple(MeshAnimation(np.array([np.nan]), still, prim=prim) for prim in prims)
    write_stage(Asset("x", meshes, "test"), tmp_path / "o.usda")
    again = read_stage(str(tmp_path / "o.usda"))
    found = {mesh.prim for mesh in again.meshes}
    assert found == {"/Mesh", "/node_1", "/node_1/mesh", "/node_1/mesh_2"}
    assert np.isnan(again.meshes[0].times).all()


def test_new_stage_of_bad_points(tmp_path: Path) -> None:
    mesh = animation(3).map(infinite)
    with pytest.raises(OutputError, match="frame 2: a point is not finite"):
        write_stage(Asset("x", (mesh,), "test"), tmp_path / "o.usda")
    assert list(tmp_path.iterdir()) == []


# Parts -------------------------------------------------------------------------------------------


def test_parts_are_a_partition_usd_accepts(tmp_path: Path) -> None:
    indexed = "color3f[] primvars:displayColor = [(1, 0, 0)]\n"
    indexed += "int[] primvars:displayColor:indices = [0, 0, 0, 0, 0, 0]"
    asset = read_stage(write_text(tmp_path / "a.usda", cube(more=indexed)))
    # The two triangles of the second face disagree: the first part of the two takes it.
    labels = np.array([0, 0, 2, 1, 1, 1, 2, 2, 2, 2, 0, 0])
    output = tmp_path / "parts.usda"
    write_parts(asset, {"/cube": labels}, output)
    stage = Usd.Stage.Open(str(output))
    mesh = UsdGeom.Mesh.Get(stage, "/cube")
    subsets = UsdGeom.Subset.GetGeomSubsets(mesh, UsdGeom.Tokens.face, "parts")
    assert [list(subset.GetIndicesAttr().Get()) for subset in subsets] == [[0, 5], [1, 2], [3, 4]]
    assert UsdGeom.Subset.GetFamilyType(mesh, "parts") == UsdGeom.Tokens.partition
    valid, reason = UsdGeom.Subset.ValidateFamily(mesh, UsdGeom.Tokens.face, "parts")
    assert valid, reason
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("displayColor")
    assert primvar.GetInterpolation() == UsdGeom.Tokens.uniform
    colours = np.array(primvar.ComputeFlattened())
    np.testing.assert_array_equal(colours, palette(3)[[0, 1, 1, 2, 2, 0]])
    np.testing.assert_array_equal(points_at(stage, "/cube"), CUBE_POINTS)


def test_parts_of_several_frames(tmp_path: Path) -> None:
    asset = read_stage(write_text(tmp_path / "a.usda", cube(points=sampled(FRAMES))))
    labels = [np.zeros(12, dtype=int), np.repeat([0, 1], 6)]
    write_parts(asset, {"/cube": labels}, tmp_path / "parts.usda", frame_indices=[0, 2])
    stage = Usd.Stage.Open(str(tmp_path / "parts.usda"))
    second = stage.GetPrimAtPath("/cube/part_1").GetAttribute("indices")
    assert second.GetTimeSamples() == [1, 4.5]
    assert [list(second.Get(time)) for time in (1, 4.5)] == [[], [3, 4, 5]]


def test_parts_that_do_not_fit(tmp_path: Path) -> None:
    asset = read_stage(write_text(tmp_path / "a.usda", cube()))
    with pytest.raises(UsageError, match="for 12 triangles"):
        write_parts(asset, {"/cube": np.zeros(6, dtype=int)}, tmp_path / "parts.usda")
    assert not (tmp_path / "parts.usda").exists()


def test_palette_is_well_separated() -> None:
    colours = palette(12)
    np.testing.assert_array_equal(colours[:5], palette(5))
    distances = np.linalg.norm(colours[:, None] - colours, axis=2) + 9 * np.eye(12)
    assert distances.min() > 0.25


# Real input --------------------------------------------------------------------------------------


def test_horse(data_folder: Path, tmp_path: Path) -> None:
    source = data_folder / "horse-gallop.usdc"
    before = digest(source)
    original = read_stage(str(source))
    output, twin = tmp_path / "marked.usdc", tmp_path / "twin.usdc"
    write_override(original, moved(original), output)
    write_override(original, moved(original), twin)
    assert digest(source) == before
    assert digest(output) == digest(twin)
    # Forty-eight frames of float32 points, and next to nothing else.
    assert output.stat().st_size < 1.01 * 48 * 8431 * 12
    layer = Sdf.Layer.FindOrOpen(str(output))
    assert_only_points(layer)
    assert layer.subLayerPaths[0] == os.path.relpath(source, tmp_path)
    assert_same_but_points(str(source), output)
    times = layer.ListTimeSamplesForPath("/Horse/Geom/body.points")
    assert times == [float(time) for time in range(1, 49)]
    old, new = Usd.Stage.Open(str(source)), Usd.Stage.Open(str(output))
    for time in (1, 24, 48):
        a, b = (points_at(stage, "/Horse/Geom/body", time) for stage in (old, new))
        assert a[::2].tobytes() == b[::2].tobytes()
        assert (a[1::2] != b[1::2]).any(axis=1).all()


@pytest.mark.parametrize(
    "name",
    [
        "usd/points-sphere.usda",
        "usd/CesiumMan.usdz",
        "usd/skel-human.usda",
        "usd/ballset/StandaloneScene/top_layer.usda",
    ],
)
def test_other_real_input(data_folder: Path, tmp_path: Path, name: str) -> None:
    source = str(data_folder / name)
    original = read_stage(source)
    marked = moved(original)
    output = tmp_path / "marked.usda"
    write_override(original, marked, output)
    assert_only_points(Sdf.Layer.FindOrOpen(str(output)))
    assert_same_but_points(source, output)
    again = read_stage(str(output))
    assert len(again.meshes) == len(original.meshes)
    for before, after in zip(marked.meshes, again.meshes, strict=True):
        np.testing.assert_array_equal(before.times, after.times)
        for index in range(len(before)):
            expected = before[index].points
            np.testing.assert_allclose(
                after[index].points, expected, rtol=0, atol=3e-7 * np.abs(expected).max()
            )
