"""A layer may hold values of another type than they should have: nothing trips over them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, Vt
from test_usd_traces import BODY, POINTS, T, stage_of, vec3f

from meshmark.usd.checking import Finding, check_stage
from meshmark.usd.delivery import write_flattened
from meshmark.usd.reading import read_stage
from meshmark.usd.writing import write_override
from usd_stages import cube, moved, write_text

pytestmark = pytest.mark.filterwarnings("error")

# In a binary layer: a field of another type whose name is as long, to be put for the other.
SWAPS = {
    "documentation of a layer": ("(startTimeCode = 2)", cube("m"), "startTimeCode"),
    "data of a layer": ("(framesPerSecond = 2)", cube("m"), "framesPerSecond"),
    "documentation of a prim": ("", cube("m", more='reorder properties = ["a"]'), "propertyOrder"),
    "data of a prim": ("", cube("m").replace('"m"', '"m" (permission = private)'), "permission"),
}
FIELDS = {
    "startTimeCode": "documentation",
    "framesPerSecond": "customLayerData",
    "propertyOrder": "documentation",
    "permission": "customData",
}


def odd_layer(folder: Path, case: str) -> tuple[Path, str]:
    metadata, body, field = SWAPS[case]
    (folder / "s.usda").write_text(f"#usda 1.0\n{metadata}\n{body}")
    source = folder / "s.usdc"
    Sdf.Layer.OpenAsAnonymous(str(folder / "s.usda")).Export(str(source))
    content = source.read_bytes()
    assert content.count(field.encode()) == 1
    source.write_bytes(content.replace(field.encode(), FIELDS[field].encode()))
    return source, FIELDS[field]


@pytest.mark.parametrize("keep_metadata", [False, True])
@pytest.mark.parametrize("case", SWAPS)
def test_it_is_delivered_without_them(tmp_path: Path, case: str, keep_metadata: bool) -> None:
    source, _ = odd_layer(tmp_path, case)
    original = read_stage(str(source))
    output = tmp_path / "o.usda"
    write_flattened(original, moved(original), output, keep_metadata=keep_metadata)
    assert len(read_stage(str(output)).meshes) == 1


@pytest.mark.parametrize("case", SWAPS)
def test_they_are_found_from_outside(tmp_path: Path, case: str) -> None:
    source, field = odd_layer(tmp_path, case)
    where = "/m" if case.endswith("prim") else "/"
    assert check_stage(str(source)) == [Finding("metadata", where, field)]


N = len(POINTS)
WHICH = np.arange(N, dtype=np.int32)
INDICES = {
    "numbers": (T.FloatArray, Vt.FloatArray.FromNumpy(WHICH.astype(np.float32))),
    "triples": (T.Int3Array, Vt.Vec3iArray.FromNumpy(np.repeat(WHICH[:, None], 3, axis=1))),
}
NO_POINTS = {
    "numbers": (T.FloatArray, Vt.FloatArray.FromNumpy(POINTS.ravel())),
    "text": (T.String, " ".join(map(str, POINTS.ravel().tolist()))),
    "quadruples": (T.Float4Array, Vt.Vec4fArray.FromNumpy(np.c_[POINTS, np.ones(N, np.float32)])),
}


def assert_copy_is_moved(stage: Usd.Stage, path: str) -> None:
    stage.Save()
    source = Path(stage.GetRootLayer().realPath)
    original = read_stage(str(source))
    told = write_flattened(original, moved(original), source.with_name("o.usdc"))
    assert [each.path for each in told.moved] == [path]
    assert all(each.kind != "copy" for each in check_stage(str(source)))


@pytest.mark.parametrize("kind", INDICES)
def test_indices_that_are_none(tmp_path: Path, kind: str) -> None:
    stage = stage_of(tmp_path / "s.usda")
    body = stage.GetPrimAtPath(BODY)
    body.CreateAttribute("primvars:rest", T.Point3fArray).Set(vec3f(POINTS))
    declared, values = INDICES[kind]
    body.CreateAttribute("primvars:rest:indices", declared).Set(values)
    assert_copy_is_moved(stage, f"{BODY}.primvars:rest")


@pytest.mark.parametrize("kind", NO_POINTS)
def test_points_of_another_type_beside_an_extent(tmp_path: Path, kind: str) -> None:
    stage = stage_of(tmp_path / "s.usda")
    other = stage.DefinePrim("/World/other")
    declared, values = NO_POINTS[kind]
    other.CreateAttribute("points", declared).Set(values)
    other.CreateAttribute("extent", T.Float3Array).Set(vec3f(POINTS[:2]))
    assert_copy_is_moved(stage, "/World/other.points")


# Of what a text layer takes a path for, whatever the field.
ROOT_ONLY = ("colorConfiguration", "defaultPrim", "expressionVariables", "startTimeCode")


@pytest.mark.parametrize("field", ROOT_ONLY)
def test_a_layer_over_it_goes_without(tmp_path: Path, field: str) -> None:
    source = write_text(tmp_path / "s.usda", cube("m"), f"{field} = </m>")
    original = read_stage(source)
    output = tmp_path / "o.usda"
    write_override(original, moved(original), output)
    assert not Sdf.Layer.FindOrOpen(str(output)).pseudoRoot.HasInfo(field)
    assert len(read_stage(str(output)).meshes) == 1


def with_field_renamed(source: Path, old: str, new: str) -> str:
    content = source.read_bytes()
    assert len(old) == len(new)
    assert content.count(old.encode()) == 1
    changed = source.with_name("changed.usdc")
    changed.write_bytes(content.replace(old.encode(), new.encode()))
    return str(changed)


def test_a_path_in_them_is_found(tmp_path: Path) -> None:
    look = 'token look (allowedTokens = ["C:/shows/secret/look.tx"])'
    text = write_text(tmp_path / "s.usda", cube("m", more=look))
    Sdf.Layer.OpenAsAnonymous(text).Export(str(tmp_path / "s.usdc"))
    changed = with_field_renamed(tmp_path / "s.usdc", "allowedTokens", "symmetricPeer")
    assert check_stage(changed) == [Finding("metadata", "/m.look", "symmetricPeer: a path")]


def test_points_in_them_are_found(tmp_path: Path) -> None:
    stage = stage_of(tmp_path / "s.usdc")
    near = POINTS + np.random.default_rng(0).normal(scale=1e-4, size=POINTS.shape)
    stage.GetPrimAtPath(BODY).SetCustomDataByKey("rest", vec3f(near))
    stage.Save()
    changed = with_field_renamed(tmp_path / "s.usdc", "customData", "permission")
    assert [each.where for each in check_stage(changed)] == [f"{BODY} permission:rest"]


@pytest.mark.parametrize(("size", "found"), [(1e60, True), (1e300, False)])
def test_a_copy_beyond_single_precision(tmp_path: Path, size: float, found: bool) -> None:
    # Squares of 1e300 are beyond double precision, too: such a copy may be missed, in silence.
    stage = stage_of(tmp_path / "s.usda")
    near = POINTS + np.random.default_rng(0).normal(scale=1e-3, size=POINTS.shape)
    rest = stage.GetPrimAtPath(BODY).CreateAttribute("primvars:rest", T.Double3Array)
    rest.Set(Vt.Vec3dArray.FromNumpy(size * near))
    stage.Save()
    where = [each.where for each in check_stage(str(tmp_path / "s.usda"))]
    assert where == ([f"{BODY}.primvars:rest"] if found else [])
