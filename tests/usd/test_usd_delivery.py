"""Flattened deliverables: one file, the same picture, and not one unmarked point."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

from meshmark.errors import OutputError, UsageError
from meshmark.mesh.asset import Asset
from meshmark.usd.delivery import write_flattened
from meshmark.usd.opening import stage_files
from meshmark.usd.reading import read_stage
from usd_stages import (
    CUBE_POINTS,
    array,
    cube,
    float_arrays,
    moved,
    points_at,
    sampled,
    write_text,
)

FRAMES = {1: CUBE_POINTS, 2: CUBE_POINTS + 1}


def source_points(files: Iterable[Path]) -> set[bytes]:
    """Every array of points anywhere in the source's layers, whatever the composition."""
    found = set()
    for path in files:
        layer = Sdf.Layer.FindOrOpen(str(path))
        assert layer
        found |= {data for name, data in float_arrays(layer) if name.endswith((".points", "Pref"))}
    return found


def deliver(source: str, output: Path, prims: list[str] | None = None) -> Sdf.Layer:
    original = read_stage(source)
    write_flattened(original, moved(read_stage(source, prims)), output)
    layer = Sdf.Layer.FindOrOpen(str(output))
    assert not layer.GetCompositionAssetDependencies()
    assert stage_files(str(output)) == [output.resolve()]
    delivered = {data for _, data in float_arrays(layer)}
    unmarked = source_points(stage_files(source))
    assert unmarked
    assert not delivered & unmarked
    return layer


def assert_shows(output: Path, marked: Asset) -> None:
    """The deliverable's meshes are the marked ones, in world space."""
    again = read_stage(str(output), [mesh.prim for mesh in marked.meshes])
    for before, after in zip(marked.meshes, again.meshes, strict=True):
        np.testing.assert_array_equal(before.times, after.times)
        for index in range(len(before)):
            expected = before[index].points
            scale = np.abs(expected).max()
            np.testing.assert_allclose(after[index].points, expected, rtol=0, atol=3e-7 * scale)
            assert before[index].topology.same_as(after[index].topology)


@pytest.mark.parametrize("suffix", [".usd", ".usda", ".usdc"])
def test_everything_a_stage_can_be_composed_of(tmp_path: Path, suffix: str) -> None:
    base = f"""
    class "_class_model"
    {{
        {cube(points=f"point3f[] points = {array(CUBE_POINTS + 7)}")}
    }}
    def Xform "model" (
        inherits = </_class_model>
        variants = {{
            string size = "small"
        }}
        prepend variantSets = "size"
    )
    {{
        double3 xformOp:translate = (1, 2, 3)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        {cube()}
        variantSet "size" = {{
            "small" {{
                over "cube"
                {{
                    color3f[] primvars:displayColor = [(1, 0, 0)]
                }}
            }}
            "large" {{
                over "cube"
                {{
                    point3f[] points = {array(CUBE_POINTS * 5)}
                }}
            }}
        }}
        {cube("pure_over", kind="over")}
    }}
    """
    write_text(tmp_path / "model.usda", base, 'defaultPrim = "model"')
    # The stage's own class is not one of a referenced file, which flattening drops by itself.
    scene = f"""
    class "_class_scene"
    {{
        {cube(points=f"point3f[] points = {array(CUBE_POINTS + 8)}")}
    }}
    def Xform "world"
    {{
        def "one" (references = @model.usda@)
        {{
            over "cube"
            {{
                {sampled(FRAMES)}
            }}
        }}
        def "two" (
            inherits = </_class_scene>
            payload = @model.usda@
        )
        {{
        }}
        {cube("dead").replace('"dead"', '"dead" ( active = false )')}
    }}
    """
    source = write_text(tmp_path / "scene.usda", scene, 'defaultPrim = "world"\nupAxis = "Z"')
    output = tmp_path / f"out{suffix}"
    layer = deliver(source, output)
    assert_shows(output, moved(read_stage(source)))
    stage = Usd.Stage.Open(str(output))
    assert stage.GetDefaultPrim().GetPath() == "/world"
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    prims = [str(prim.GetPath()) for prim in stage.TraverseAll()]
    assert prims == ["/world", "/world/one", "/world/one/cube", "/world/two", "/world/two/cube"]
    colour = stage.GetPrimAtPath("/world/two/cube").GetAttribute("primvars:displayColor")
    np.testing.assert_array_equal(colour.Get(), [(1, 0, 0)])
    # The referenced model's default would be an unmarked pose beside the marked samples.
    assert layer.GetAttributeAtPath("/world/one/cube.points").default is None
    assert str(tmp_path) not in layer.ExportToString()
    assert "model.usda" not in layer.ExportToString()
    expected = b"#usda" if suffix == ".usda" else b"PXR-USDC"
    assert output.read_bytes().startswith(expected)


def test_instances_become_prims_of_their_own(tmp_path: Path) -> None:
    inner = 'def "in" (references = @cube.usda@\n instanceable = true)\n{\n}\n'
    write_text(tmp_path / "cube.usda", f'def Xform "M"\n{{{cube()}}}', 'defaultPrim = "M"')
    write_text(tmp_path / "nest.usda", f'def Xform "N"\n{{{inner}}}', 'defaultPrim = "N"')
    body = "".join(
        f"""
        def "{name}" (references = @{file}.usda@
            instanceable = true)
        {{
            double3 xformOp:translate = ({x}, 0, 0)
            uniform token[] xformOpOrder = ["xformOp:translate"]
        }}
        """
        for name, file, x in (("a", "cube", 0), ("b", "cube", 5), ("c", "nest", 9))
    )
    source = write_text(tmp_path / "scene.usda", body)
    asset = read_stage(source)
    assert [mesh.prim for mesh in asset.meshes] == ["/a/cube", "/b/cube", "/c/in/cube"]
    different = tuple(
        moved(replace(asset, meshes=(mesh,)), seed).meshes[0]
        for seed, mesh in enumerate(asset.meshes)
    )
    marked = replace(asset, meshes=different)
    write_flattened(asset, marked, tmp_path / "out.usda")
    assert_shows(tmp_path / "out.usda", marked)
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "out.usda"))
    assert not {data for _, data in float_arrays(layer)} & source_points(stage_files(source))
    stage = Usd.Stage.Open(layer)
    assert stage.GetPrototypes() == []
    assert [prim.name for prim in layer.rootPrims] == ["a", "b", "c"]
    local = [points_at(stage, mesh.prim) for mesh in asset.meshes]
    assert not np.array_equal(local[0], local[1])


def test_copies_that_were_not_marked_get_the_marked_points(tmp_path: Path) -> None:
    pref = f'point3f[] primvars:Pref = {array(CUBE_POINTS)} (interpolation = "vertex")'
    box = "float3[] extent = [(0, 0, 0), (1, 1, 1)]"
    other = cube("other", f"point3f[] points = {array(CUBE_POINTS + 3)}")
    body = cube("a", sampled(FRAMES), pref) + cube("copy", more=box)
    source = write_text(tmp_path / "scene.usda", body + other)
    original = read_stage(source)
    marked = moved(read_stage(source, ["/a"]))
    write_flattened(original, marked, tmp_path / "out.usda")
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    first = points_at(stage, "/a", 1)
    assert not np.array_equal(first, CUBE_POINTS)
    np.testing.assert_array_equal(points_at(stage, "/copy"), first)
    np.testing.assert_array_equal(
        stage.GetPrimAtPath("/a").GetAttribute("primvars:Pref").Get(), first
    )
    extent = stage.GetPrimAtPath("/copy").GetAttribute("extent").Get()
    np.testing.assert_array_equal(extent, [first.min(0), first.max(0)])
    # Another mesh, which nobody asked to mark, is delivered as it is.
    np.testing.assert_array_equal(points_at(stage, "/other"), CUBE_POINTS + 3)


def test_a_reference_pose_follows_its_own_mesh(tmp_path: Path) -> None:
    pref = f"point3f[] primvars:Pref = {array(CUBE_POINTS)}"
    source = write_text(tmp_path / "scene.usda", cube("a", more=pref) + cube("b", more=pref))
    asset = read_stage(source)
    a, b = asset.meshes
    marked = replace(asset, meshes=(a, moved(replace(asset, meshes=(b,)), seed=5).meshes[0]))
    marked = replace(
        marked, meshes=(moved(replace(asset, meshes=(a,))).meshes[0], marked.meshes[1])
    )
    write_flattened(asset, marked, tmp_path / "out.usda")
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    for path in ("/a", "/b"):
        reference = stage.GetPrimAtPath(path).GetAttribute("primvars:Pref").Get()
        np.testing.assert_array_equal(reference, points_at(stage, path))
    assert not np.array_equal(points_at(stage, "/a"), points_at(stage, "/b"))


def test_prototypes_of_point_instancers_stay(tmp_path: Path) -> None:
    body = f"""
    def PointInstancer "many"
    {{
        int[] protoIndices = [0, 1]
        point3f[] positions = [(0, 0, 0), (5, 0, 0)]
        rel prototypes = [</many/cube>, </store/hidden>]
        {cube()}
    }}
    over "store"
    {{
        {cube("hidden", f"point3f[] points = {array(CUBE_POINTS + 4)}")}
        {cube("litter", f"point3f[] points = {array(CUBE_POINTS + 5)}", kind="over")}
    }}
    """
    source = write_text(tmp_path / "scene.usda", body)
    asset = read_stage(source)
    assert [mesh.prim for mesh in asset.meshes] == ["/many/cube"]
    write_flattened(asset, moved(asset), tmp_path / "out.usda")
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    assert not np.array_equal(points_at(stage, "/many/cube"), CUBE_POINTS)
    assert stage.GetPrimAtPath("/store/hidden")
    assert not stage.GetPrimAtPath("/store/litter")
    targets = UsdGeom.PointInstancer.Get(stage, "/many").GetPrototypesRel().GetTargets()
    assert targets == ["/many/cube", "/store/hidden"]


def test_every_frame_must_be_marked(tmp_path: Path) -> None:
    source = write_text(tmp_path / "a.usda", cube(points=sampled(FRAMES)))
    original = read_stage(source)
    some = replace(original, meshes=(moved(original).meshes[0].select([0]),))
    with pytest.raises(UsageError, match=r"/cube: frame 2: 1 frames .* not marked"):
        write_flattened(original, some, tmp_path / "o.usda")
    with pytest.raises(OutputError, match="part of the source"):
        write_flattened(original, moved(original), tmp_path / "a.usda")
    assert [path.name for path in tmp_path.iterdir()] == ["a.usda"]


def test_horse(data_folder: Path, tmp_path: Path) -> None:
    source = str(data_folder / "horse-gallop.usdc")
    output, twin = tmp_path / "a.usdc", tmp_path / "b.usdc"
    deliver(source, output)
    deliver(source, twin)
    assert output.read_bytes() == twin.read_bytes()
    assert_shows(output, moved(read_stage(source)))


def test_assembled_stage(data_folder: Path, tmp_path: Path) -> None:
    source = str(data_folder / "usd" / "ballset" / "StandaloneScene" / "top_layer.usda")
    before = {path: hashlib.sha256(path.read_bytes()).digest() for path in stage_files(source)}
    layer = deliver(source, tmp_path / "out.usdc")
    assert_shows(tmp_path / "out.usdc", moved(read_stage(source)))
    text = layer.ExportToString()
    assert "variantSet" not in text
    assert str(data_folder) not in text
    assert {path: hashlib.sha256(path.read_bytes()).digest() for path in before} == before


@pytest.mark.slow
def test_man_in_a_package(data_folder: Path, tmp_path: Path) -> None:
    source = str(data_folder / "usd" / "CesiumMan.usdz")
    original = read_stage(source)
    output = tmp_path / "man.usda"
    write_flattened(original, moved(original), output)
    assert_shows(output, moved(original))
    assert "CesiumMan.usdz" not in output.read_text()
    (texture,) = (tmp_path / "man.usda.assets").rglob("*.jpg")
    assert texture.stat().st_size > 1000
