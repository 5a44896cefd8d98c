"""Points and faces in every type a stage may hold them in, and in those it may not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Sdf, Usd, Vt

from meshmark.errors import InputError, OutputError
from meshmark.usd.delivery import write_flattened
from meshmark.usd.geometry import transformed
from meshmark.usd.reading import read_stage
from meshmark.usd.stages import write_stage
from meshmark.usd.writing import write_override
from usd_stages import CUBE_POINTS, array, cube, moved, points_at, read_one, sampled, write_text

PRECISIONS = {"half3": np.float16, "float3": np.float32, "double3": np.float64}
FAR = np.array([5e6, 0, 0])


def points(kind: str, values: np.ndarray = CUBE_POINTS) -> str:
    return f"{kind}[] points = {array(values)}"


@pytest.mark.parametrize("role", ["{}3", "point3{}", "vector3{}", "normal3{}", "color3{}"])
@pytest.mark.parametrize("precision", ["half", "float", "double"])
def test_every_role_and_precision_of_points_is_read(
    tmp_path: Path, role: str, precision: str
) -> None:
    kind = role.format(precision if role == "{}3" else precision[0])
    mesh = read_one(write_text(tmp_path / "a.usda", cube(points=points(kind))))
    assert mesh.dtype == np.dtype(PRECISIONS[f"{precision}3"]).name
    np.testing.assert_array_equal(mesh[0].points, CUBE_POINTS)


STRANGE = {
    "integers": "int[] points = [0, 1, 2]",
    "one number": "int points = 3",
    "one point": "point3f points = (1, 2, 3)",
    "pairs": "float2[] points = [(0, 0), (1, 0), (1, 1)]",
    "fours": "float4[] points = [(0, 0, 0, 1), (1, 0, 0, 1), (1, 1, 0, 1)]",
    "numbers": "double[] points = [0, 1, 2]",
    "texts": 'string[] points = ["0", "1"]',
    "matrices": "matrix3d[] points = [((1, 0, 0), (0, 1, 0), (0, 0, 1))]",
    "whole numbers": "int3[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0)]",
}


@pytest.mark.parametrize("name", STRANGE)
def test_points_of_other_types_are_refused_mesh_by_mesh(tmp_path: Path, name: str) -> None:
    bad = cube("bad", STRANGE[name])
    with pytest.raises(InputError, match=r"/bad: points of type \w+; they must be an array of"):
        read_stage(write_text(tmp_path / "alone.usda", bad))
    asset = read_stage(write_text(tmp_path / "both.usda", cube("good") + bad))
    assert [mesh.prim for mesh in asset.meshes] == ["/good"]
    assert asset.notes[0].startswith("/bad: left out: points of type ")


@pytest.mark.parametrize("kind", ["int", "uint", "int64", "uint64", "uchar"])
def test_every_type_of_integers_is_read(tmp_path: Path, kind: str) -> None:
    body = cube().replace("int[]", f"{kind}[]")
    assert len(read_one(write_text(tmp_path / "a.usda", body))[0].faces) == 12


@pytest.mark.parametrize("given", ["float[]", "half[]", "int2[]", "string[]"])
@pytest.mark.parametrize("name", ["faceVertexCounts", "faceVertexIndices"])
def test_faces_of_other_types_are_refused(tmp_path: Path, name: str, given: str) -> None:
    value = {"int2[]": "[(4, 4), (4, 4)]", "string[]": '["4", "4"]'}.get(given, "[4, 4]")
    lines = cube().splitlines()
    body = "\n".join(f"{given} {name} = {value}" if name in line else line for line in lines)
    with pytest.raises(InputError, match=rf"/cube: {name} of type \w+; it must be an array of int"):
        read_stage(write_text(tmp_path / "a.usda", body))


def test_one_number_of_corners_is_refused(tmp_path: Path) -> None:
    body = "\n".join(
        "int faceVertexCounts = 4" if "Counts" in line else line for line in cube().splitlines()
    )
    with pytest.raises(InputError, match="faceVertexCounts of type int; it must be an array"):
        read_stage(write_text(tmp_path / "a.usda", body))


@pytest.mark.parametrize("count", [2**62, 2**63 - 1, 2**31])
def test_more_corners_than_can_be_counted_are_refused(tmp_path: Path, count: int) -> None:
    # Four times 2**62 is nothing at all, in 64 bits.
    body = cube().replace("int[] faceVertexCounts", "int64[] faceVertexCounts")
    body = body.replace(str([4] * 6), str([count] * 4))
    with pytest.raises(InputError, match=f"where {4 * count:.0f} are expected"):
        read_stage(write_text(tmp_path / "a.usda", body))


@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
@pytest.mark.parametrize("kind", PRECISIONS)
def test_points_are_written_in_the_type_they_had(tmp_path: Path, kind: str, suffix: str) -> None:
    statement = sampled({1: CUBE_POINTS, 2: CUBE_POINTS + 1}).replace("point3f", kind)
    original = read_stage(write_text(tmp_path / "a.usda", cube(points=statement)))
    marked = moved(original)
    for name, write in (("over", write_override), ("flat", write_flattened)):
        output = tmp_path / f"{name}{suffix}"
        write(original, marked, output)
        stage = Usd.Stage.Open(str(output))
        for frame in marked.meshes[0]:
            found = points_at(stage, "/cube", frame.time)
            assert found.dtype == PRECISIONS[kind]
            np.testing.assert_array_equal(found, frame.points.astype(PRECISIONS[kind]))
        spec = Sdf.Layer.FindOrOpen(str(output)).GetAttributeAtPath("/cube.points")
        assert spec.typeName.type.pythonClass is type(
            stage.GetPrimAtPath("/cube").GetAttribute("points").Get(1)
        )


@pytest.mark.parametrize("kind", ["float3", "double3"])
def test_double_precision_survives_a_new_stage(tmp_path: Path, kind: str) -> None:
    source = tmp_path / "a.usda"
    layer = Sdf.Layer.FindOrOpen(write_text(source, cube(points=points(kind))))
    far = CUBE_POINTS + FAR + 1e-4
    if kind == "double3":
        layer.GetAttributeAtPath("/cube.points").default = Vt.Vec3dArray.FromNumpy(far)
        layer.Save()
    asset = read_stage(str(source))
    write_stage(asset, tmp_path / "new.usdc")
    found = points_at(Usd.Stage.Open(str(tmp_path / "new.usdc")), "/cube")
    assert found.dtype == PRECISIONS[kind]
    np.testing.assert_array_equal(found, far if kind == "double3" else CUBE_POINTS)


@pytest.mark.parametrize(
    "statement",
    [
        'string[] primvars:st = ["a", "b"] (interpolation = "faceVarying")',
        'int primvars:st = 3 (interpolation = "vertex")',
        'texCoord2f[] primvars:st = [(0, 0)] (interpolation = "vertex")',
        'texCoord2f[] primvars:st = [(0, 0)] (interpolation = "vertex")\n'
        "int[] primvars:st:indices = [0, 1, -7, 99999, 0, 0, 0, 0]",
        'token[] primvars:st = ["a"] (interpolation = "nonsense")',
        'texCoord2f primvars:st = (0, 0) (interpolation = "vertex")',
    ],
)
def test_texture_coordinates_that_are_none_are_not_read(tmp_path: Path, statement: str) -> None:
    from meshmark.usd.texture_coordinates import read_texture_coordinates

    source = write_text(tmp_path / "a.usda", cube(more=statement))
    assert read_texture_coordinates(source, "/cube") is None


@pytest.mark.parametrize("where", ['(doc="caf\xe9")', '(comment="\xfc\xff")', "# caf\xe9\n"])
def test_text_that_is_not_utf_8_is_refused_in_one_line(tmp_path: Path, where: str) -> None:
    text = cube("m").replace('"m"', f'"m" {where}')
    path = tmp_path / "a.usda"
    path.write_bytes(f"#usda 1.0\n{text}".encode("latin-1"))
    with pytest.raises(InputError, match="not readable as USD: ") as caught:
        read_stage(str(path))
    assert "\n" not in str(caught.value)
    assert "pegtl" not in str(caught.value)


TRANSFORMS = {
    "scale (1e150, 1e150, 1e150)": "too far from the origin",
    "scale (1e300, 1, 1)": "too far from the origin",
    "translate (0, 1e300, 0)": "too far from the origin",
    "translate (0, 0, -1e39)": "too far from the origin",
    "scale (inf, 1, 1)": "transform to world space is not finite",
    "translate (nan, 0, 0)": "transform to world space is not finite",
}


def transformed_cube(operation: str) -> str:
    name, values = operation.split(" ", 1)
    return f"""
    def Xform "outer"
    {{
        double3 xformOp:{name} = {values}
        uniform token[] xformOpOrder = ["xformOp:{name}"]
        {cube()}
    }}
    """


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("operation", TRANSFORMS)
def test_transforms_beyond_all_measure_are_refused(tmp_path: Path, operation: str) -> None:
    with pytest.raises(InputError, match=TRANSFORMS[operation]) as caught:
        read_stage(write_text(tmp_path / "a.usda", transformed_cube(operation)))
    assert caught.value.prim == "/outer/cube"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("z", ["0", "1e-30", "1e-300", "1e30"])
@pytest.mark.parametrize("scheme", ["apex", "tsai2014", "cho2007"])
def test_flat_and_needle_thin_meshes_are_no_bugs(tmp_path: Path, z: str, scheme: str) -> None:
    from meshmark.commands.inspect import inspect_asset
    from meshmark.extension.recipe import Recipe

    source = write_text(tmp_path / "a.usda", transformed_cube(f"scale (1, 1, {z})"))
    (found,) = inspect_asset(read_stage(source), Recipe(scheme))["prims"]
    assert not found["can_hold"]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("write", [write_override, write_flattened])
def test_points_that_their_type_does_not_hold_are_not_written(tmp_path: Path, write: Any) -> None:
    statement = points("half3", 6e4 * CUBE_POINTS.astype(float))
    original = read_stage(write_text(tmp_path / "a.usda", cube(points=statement)))
    mesh = original.meshes[0].map(lambda frame: frame.moved(1.1 * frame.points))
    with pytest.raises(OutputError, match="/cube: a point is beyond the range of float16"):
        write(original, replace(original, meshes=(mesh,)), tmp_path / "o.usda")
    assert not (tmp_path / "o.usda").exists()


@pytest.mark.filterwarnings("error")
def test_a_box_that_single_precision_does_not_hold_is_as_large_as_it_can_be(tmp_path: Path) -> None:
    statement = points("double3", 3e38 * CUBE_POINTS.astype(float))
    original = read_stage(write_text(tmp_path / "a.usda", cube(points=statement)))
    mesh = original.meshes[0].map(lambda frame: frame.moved(1.2 * frame.points))
    write_override(original, replace(original, meshes=(mesh,)), tmp_path / "o.usda")
    stage = Usd.Stage.Open(str(tmp_path / "o.usda"))
    box = stage.GetAttributeAtPath("/cube.extent").Get()
    assert np.abs(box).max() == np.finfo(np.float32).max


def test_a_transform_that_moves_nothing_changes_no_bit():
    points = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    points[0] = -0.0, 0.0, np.finfo(np.float32).max
    # The last number is not looked at, but makes it take the long way.
    nearly = np.eye(4)
    nearly[3, 3] = 2.0
    found, wanted = (transformed(points, matrix) for matrix in (np.eye(4), nearly))
    assert found.tobytes() == wanted.tobytes()
