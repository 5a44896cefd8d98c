"""Override layers and new stages out: nothing but moved points, every frame, bit by bit."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdUtils

from meshmark.usd import layers
from meshmark.usd.reading import read_stage
from meshmark.usd.writing import write_override
from usd_stages import CUBE_POINTS, FRAMES, cube, digest, moved, points_at, sampled, write_text

# What takes a rigged mesh from its skeleton.
BAKED = ("skel:skeleton", "normals")


def specs(layer: Sdf.Layer) -> list[Sdf.Path]:
    paths: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    return [path for path in paths if path != Sdf.Path.absoluteRootPath]


def assert_only_points(layer: Sdf.Layer, *also: str) -> None:
    """Only `over` specs, with nothing but points and extent."""
    for path in specs(layer):
        if path.IsPrimPath():
            prim = layer.GetPrimAtPath(path)
            assert prim.specifier == Sdf.SpecifierOver
            assert set(prim.ListInfoKeys()) <= {"specifier"}
        else:
            assert path.name in ("points", "extent", *also)


def assert_same_but_points(source: str, output: Path, *also: str) -> None:
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
            if name not in ("points", "extent", *also):
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
    write_override(original, marked, output, primvars="keep")
    baked = BAKED if any(mesh.notes for mesh in original.meshes) else ()
    assert_only_points(Sdf.Layer.FindOrOpen(str(output)), *baked)
    assert_same_but_points(source, output, *baked)
    again = read_stage(str(output))
    assert len(again.meshes) == len(original.meshes)
    for before, after in zip(marked.meshes, again.meshes, strict=True):
        np.testing.assert_array_equal(before.times, after.times)
        for index in range(len(before)):
            expected = before[index].points
            np.testing.assert_allclose(
                after[index].points, expected, rtol=0, atol=3e-7 * np.abs(expected).max()
            )
