"""No copy of unmarked points stays in a deliverable, in whatever form; no word of the studio."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from meshmark.testing.attacks import sphere
from meshmark.usd.delivery import Delivery, write_flattened
from meshmark.usd.reading import read_stage
from usd_stages import moved, write_text

T = Sdf.ValueTypeNames
V, F = sphere(700)
POINTS = (V * (1 + 0.3 * V[:, :1] ** 3 + 0.1 * np.sin(5 * V[:, 1:2])) * [3, 2, 5]).astype(
    np.float32
)
LATER = (POINTS + 0.2 * np.sin(POINTS[:, [1, 2, 0]])).astype(np.float32)
CORNERS = F.reshape(-1)
ORDER = np.random.default_rng(3).permutation(len(V))
TURN = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
BODY = "/World/body"


def vec3f(P: np.ndarray) -> Vt.Vec3fArray:
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(P, dtype=np.float32))


def matrices(P: np.ndarray) -> Vt.Matrix4dArray:
    M = np.tile(np.eye(4), (len(P), 1, 1))
    M[:, 3, :3] = P
    return Vt.Matrix4dArray.FromNumpy(M)


def spelt(point: np.ndarray) -> str:
    return ",".join(f"{x:.6g}" for x in point)


FORMS: dict[str, tuple[Sdf.ValueTypeName, Callable[[np.ndarray], Any]]] = {
    "single": (T.Point3fArray, vec3f),
    "double": (T.Double3Array, lambda P: Vt.Vec3dArray.FromNumpy(P.astype(np.float64))),
    "half": (T.Half3Array, lambda P: Vt.Vec3hArray.FromNumpy(P.astype(np.float16))),
    "colour": (T.Color3fArray, lambda P: vec3f((P + 6) / 12)),
    "flat": (T.FloatArray, lambda P: Vt.FloatArray.FromNumpy(P.ravel().astype(np.float32))),
    "flat_double": (T.DoubleArray, lambda P: Vt.DoubleArray.FromNumpy(P.ravel().astype(float))),
    "planar": (T.FloatArray, lambda P: Vt.FloatArray.FromNumpy(P.T.ravel().astype(np.float32))),
    "one_coordinate": (T.FloatArray, lambda P: Vt.FloatArray.FromNumpy(P[:, 1].astype(np.float32))),
    "with_w": (
        T.Float4Array,
        lambda P: Vt.Vec4fArray.FromNumpy(np.c_[P, np.ones(len(P))].astype(np.float32)),
    ),
    "matrices": (T.Matrix4dArray, matrices),
    "integers": (T.Int3Array, lambda P: Vt.Vec3iArray.FromNumpy(np.rint(P * 1e5).astype(np.int32))),
    "bytes": (
        T.UCharArray,
        lambda P: Vt.UCharArray.FromNumpy(
            np.ascontiguousarray(P, dtype=np.float32).view(np.uint8).ravel()
        ),
    ),
    "scaled": (T.Point3fArray, lambda P: vec3f(P * 0.01)),
    "turned": (T.Point3fArray, lambda P: vec3f(P @ TURN * 7 + 100)),
    "next": (T.Point3fArray, lambda P: vec3f(np.nextafter(P.astype(np.float32), np.float32(1e9)))),
    "decimals": (T.Point3fArray, lambda P: vec3f(P.astype(np.float64).round(4))),
    "corners": (T.Point3fArray, lambda P: vec3f(P[CORNERS])),
    "fewer": (T.Point3fArray, lambda P: vec3f(P[:-9])),
    "shuffled": (T.Point3fArray, lambda P: vec3f(P[ORDER] * 2)),
    "shuffled_flat": (T.FloatArray, lambda P: Vt.FloatArray.FromNumpy(P[ORDER].ravel())),
    "text": (T.String, lambda P: " ".join(f"{x:.6g}" for x in P.astype(np.float32).ravel())),
    "texts": (T.StringArray, lambda P: Vt.StringArray([spelt(p) for p in P])),
}  # fmt: skip


def as_numbers(value: Any) -> np.ndarray:
    if isinstance(value, str):
        return np.array(value.split(), dtype=float)
    if isinstance(value, Vt.StringArray):
        return np.array([text.split(",") for text in value], dtype=float)
    array = np.asarray(value)
    return (array.view(np.float32) if array.dtype == np.uint8 else array).astype(float)


def stage_of(path: Path, times: tuple[float, ...] = ()) -> Usd.Stage:
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.Xform.Define(stage, "/World").AddTranslateOp().Set(Gf.Vec3d(10, 0, 3))
    mesh = UsdGeom.Mesh.Define(stage, BODY)
    mesh.CreateFaceVertexCountsAttr([3] * len(F))
    mesh.CreateFaceVertexIndicesAttr(CORNERS.tolist())
    if times:
        for time, points in zip(times, (POINTS, LATER), strict=False):
            mesh.CreatePointsAttr().Set(vec3f(points), time)
    else:
        mesh.CreatePointsAttr(vec3f(POINTS))
    return stage


def deliver(stage: Usd.Stage, **options: Any) -> tuple[Usd.Stage, Delivery]:
    stage.Save()
    path = Path(stage.GetRootLayer().realPath)
    original = read_stage(str(path))
    only = [mesh.prim for mesh in original.meshes if mesh.prim == BODY]
    output = path.with_name(f"out{len(options)}.usda")
    told = write_flattened(original, moved(read_stage(str(path), only)), output, **options)
    return Usd.Stage.Open(str(output)), told


def marked(stage: Usd.Stage, time: float | None = None) -> np.ndarray:
    attribute = stage.GetAttributeAtPath(f"{BODY}.points")
    return np.array(attribute.Get() if time is None else attribute.Get(time))


def assert_follows(value: Any, form: str, after: np.ndarray, before: np.ndarray = POINTS) -> None:
    """The value is made of the marked points as it was of the unmarked ones."""
    make = FORMS[form][1]
    numbers, expected, unmarked = (as_numbers(each) for each in (value, make(after), make(before)))
    step = np.abs(expected - unmarked).max()
    assert step > 0
    coarse = np.abs(np.spacing(expected.astype(np.float16))).max() if form == "half" else 0
    allowed = max(1e-5 * np.abs(expected).max(), 2 * coarse, {"decimals": 1e-4}.get(form, 0))
    np.testing.assert_allclose(numbers, expected, rtol=0, atol=allowed)
    if form not in ("half", "decimals"):
        assert np.abs(numbers - unmarked).max() > 0.5 * step


@pytest.mark.parametrize("form", FORMS)
def test_a_copy_on_the_mesh_follows(tmp_path: Path, form: str) -> None:
    kind, make = FORMS[form]
    stage = stage_of(tmp_path / "s.usda")
    stage.GetPrimAtPath(BODY).CreateAttribute("primvars:rest", kind).Set(make(POINTS))
    out, told = deliver(stage)
    attribute = out.GetAttributeAtPath(f"{BODY}.primvars:rest")
    assert attribute.GetTypeName() == kind
    assert_follows(attribute.Get(), form, marked(out))
    assert [(each.path, each.prim) for each in told.moved] == [(f"{BODY}.primvars:rest", BODY)]


@pytest.mark.parametrize("form", ["single", "half", "shuffled", "corners", "text"])
@pytest.mark.parametrize("where", ["samples", "another prim", "metadata"])
def test_a_copy_elsewhere_follows(tmp_path: Path, form: str, where: str) -> None:
    kind, make = FORMS[form]
    stage = stage_of(tmp_path / "s.usda", times=(1, 2))
    other = stage.DefinePrim("/Store", "Scope")
    if where == "samples":
        attribute = stage.GetPrimAtPath(BODY).CreateAttribute("rest", kind)
        attribute.Set(make(LATER), 7)
        attribute.Set(make(POINTS), 9)
    elif where == "another prim":
        other.CreateAttribute("rest", kind).Set(make(LATER))
    else:
        other.SetCustomDataByKey("some:where", make(LATER))
    out, told = deliver(stage, keep_metadata=True)
    assert len(told.moved) == 1
    if where == "samples":
        attribute = out.GetAttributeAtPath(f"{BODY}.rest")
        assert_follows(attribute.Get(7), form, marked(out, 2), LATER)
        assert_follows(attribute.Get(9), form, marked(out, 1))
    elif where == "another prim":
        assert_follows(out.GetAttributeAtPath("/Store.rest").Get(), form, marked(out, 2), LATER)
    else:
        value = out.GetPrimAtPath("/Store").GetCustomDataByKey("some:where")
        assert_follows(value, form, marked(out, 2), LATER)
        assert not deliver(stage)[0].GetPrimAtPath("/Store").HasAuthoredCustomData()


def test_other_geometry_follows(tmp_path: Path) -> None:
    stage = stage_of(tmp_path / "s.usda")
    world = POINTS + np.float32([10, 0, 3])
    UsdGeom.Points.Define(stage, "/pts").CreatePointsAttr(vec3f(world[ORDER][:500]))
    curves = UsdGeom.BasisCurves.Define(stage, "/curves")
    curves.CreatePointsAttr(vec3f(POINTS))
    curves.CreateCurveVertexCountsAttr([len(V)])
    curves.CreateExtentAttr([(0, 0, 0), (1, 1, 1)])
    twin = UsdGeom.Mesh.Define(stage, "/twin")
    twin.CreatePointsAttr(vec3f(POINTS * [-1, 1, 1]))
    twin.CreateFaceVertexCountsAttr([3] * len(F))
    twin.CreateFaceVertexIndicesAttr(CORNERS.tolist())
    lod = UsdGeom.Mesh.Define(stage, "/lod")
    lod.CreatePointsAttr(vec3f(POINTS[::2]))
    lod.CreateFaceVertexCountsAttr([3])
    lod.CreateFaceVertexIndicesAttr([0, 1, 2])
    shape = stage.DefinePrim("/shape", "BlendShape")
    shape.CreateAttribute("offsets", T.Vector3fArray).Set(vec3f(POINTS * 2))
    many = stage.DefinePrim("/many", "PointInstancer")
    many.CreateAttribute("positions", T.Point3fArray).Set(vec3f(POINTS))
    out, told = deliver(stage)
    M = marked(out)
    expected = {
        "/pts.points": (M + np.float32([10, 0, 3]))[ORDER][:500],
        "/curves.points": M,
        "/twin.points": M * [-1, 1, 1],
        "/lod.points": M[::2],
        "/shape.offsets": M * 2,
        "/many.positions": M,
    }
    assert sorted(each.path for each in told.moved) == sorted(expected)
    for path, points in expected.items():
        np.testing.assert_allclose(out.GetAttributeAtPath(path).Get(), points, atol=3e-6)
    np.testing.assert_array_equal(
        out.GetAttributeAtPath("/curves.extent").Get(), [M.min(axis=0), M.max(axis=0)]
    )


def test_an_indexed_copy_follows(tmp_path: Path) -> None:
    stage = stage_of(tmp_path / "s.usda")
    primvar = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(BODY)).CreatePrimvar(
        "rest", T.Point3fArray, UsdGeom.Tokens.faceVarying
    )
    primvar.Set(vec3f(POINTS[ORDER]))
    place = np.argsort(ORDER)
    primvar.SetIndices(Vt.IntArray.FromNumpy(place[CORNERS].astype(np.int32)))
    out, _ = deliver(stage)
    found = out.GetAttributeAtPath(f"{BODY}.primvars:rest").Get()
    np.testing.assert_allclose(found, marked(out)[ORDER], atol=2e-6)
    indices = out.GetAttributeAtPath(f"{BODY}.primvars:rest:indices").Get()
    np.testing.assert_array_equal(indices, place[CORNERS])


def test_what_is_no_copy_stays_to_the_bit(tmp_path: Path) -> None:
    stage = stage_of(tmp_path / "s.usda", times=(1, 2))
    body = stage.GetPrimAtPath(BODY)
    rng = np.random.default_rng(0)
    normals = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)
    others = {
        "normals": (T.Normal3fArray, vec3f(normals)),
        "primvars:st": (T.TexCoord2fArray, Vt.Vec2fArray.FromNumpy(rng.random((len(V), 2), "f4"))),
        "primvars:displayColor": (T.Color3fArray, vec3f(rng.random((len(V), 3)))),
        "primvars:weights": (T.FloatArray, Vt.FloatArray.FromNumpy(rng.random(4 * len(V), "f4"))),
        "primvars:pose": (T.Point3fArray, vec3f(POINTS + 0.5 * np.sin(2 * POINTS[:, ::-1]))),
        "primvars:ids": (T.IntArray, Vt.IntArray.FromNumpy(np.arange(len(V), dtype="i4"))),
    }
    for name, (kind, value) in others.items():
        body.CreateAttribute(name, kind).Set(value)
    egg = UsdGeom.Mesh.Define(stage, "/egg")
    E = V * [1, 1.2, 2]
    egg.CreatePointsAttr(vec3f(E))
    egg.CreateFaceVertexCountsAttr([3] * len(F))
    egg.CreateFaceVertexIndicesAttr(CORNERS.tolist())
    out, told = deliver(stage, primvars="keep")
    assert told.moved == ()
    for name, (_, value) in others.items():
        np.testing.assert_array_equal(out.GetAttributeAtPath(f"{BODY}.{name}").Get(), value)
    np.testing.assert_array_equal(out.GetAttributeAtPath("/egg.points").Get(), vec3f(E))


SECRETS = ("secret_show", "somebody", "workstation7", "internal remark", "nine_lives")
STUDIO = """
def Xform "World" (
    "internal remark"
    doc = "rigged by somebody"
    assetInfo = {
        asset identifier = @/studio/secret_show/body.usda@
        string name = "nine_lives"
        string licence = "For viewing only, see /studio/secret_show/terms.txt"
    }
    customData = {
        string author = "somebody"
        dictionary more = {
            string path = "C:/studio/secret_show/body.ma"
        }
    }
)
{
    custom string userProperties:src = "/studio/secret_show/one.usdc"
    custom string userProperties:win = "C:\\\\studio\\\\secret_show\\\\one.usdc"
    custom string userProperties:unc = "\\\\\\\\server\\\\secret_show\\\\one.usdc"
    custom string userProperties:home = "~somebody/secret_show/one.usdc"
    custom string userProperties:author = "somebody"
    custom string userProperties:hostname = "workstation7"
    custom string[] userProperties:all = ["see /studio/secret_show/a.ma", "plain"]
    custom string userProperties:sampled.timeSamples = { 1: "file:///studio/secret_show/x.usd" }
    custom string userProperties:copyright = "Studio"
    string plain = "a/b and 1/2"
    string path = "/World/body"
    token up = "../../secret_show/tex.png"
    asset tex = @/studio/secret_show/skin.png@
    asset wintex = @C:/studio/secret_show/skin.png@
    asset tiles = @/studio/secret_show/skin.<UDIM>.png@
}
"""
LAYER = """
"internal remark"
doc = "made by somebody"
customLayerData = {
    string author = "somebody"
    string file = "/studio/secret_show/s.usda"
    string copyright = "Copyright Studio"
}
owner = "somebody"
"""


def test_what_tells_of_the_studio_goes(tmp_path: Path) -> None:
    geometry = stage_of(tmp_path / "geo.usda")
    geometry.GetRootLayer().customLayerData = {"license": "CC", "tool": "secret_show exporter"}
    geometry.GetRootLayer().documentation = "Terms of use: none"
    geometry.Save()
    source = write_text(tmp_path / "s.usda", STUDIO, LAYER + "subLayers = [@./geo.usda@]")
    original = read_stage(source)
    told = write_flattened(original, moved(original), tmp_path / "out.usda")
    text = (tmp_path / "out.usda").read_text()
    for secret in SECRETS:
        assert secret not in text, secret
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "out.usda"))
    assert dict(layer.customLayerData) == {"copyright": "Copyright Studio", "license": "CC"}
    assert layer.documentation == "Terms of use: none"
    stage = Usd.Stage.Open(layer)
    world = stage.GetPrimAtPath("/World")
    assert world.GetAssetInfo() == {"licence": "For viewing only, see terms.txt"}
    values = {attribute.GetName(): attribute.Get() for attribute in world.GetAttributes()}
    assert values["userProperties:src"] == "one.usdc"
    assert values["userProperties:win"] == "one.usdc"
    assert values["userProperties:unc"] == "one.usdc"
    assert list(values["userProperties:all"]) == ["see a.ma", "plain"]
    assert values["userProperties:copyright"] == "Studio"
    assert values["plain"] == "a/b and 1/2"
    assert values["path"] == "/World/body"
    assert values["up"] == "tex.png"
    assert values["tex"].path == values["wintex"].path == "skin.png"
    assert values["tiles"].path == "skin.<UDIM>.png"
    assert "userProperties:author" not in values
    assert "userProperties:hostname" not in values
    for where in ("author", "World: documentation", "assetInfo:name", "userProperties:src", "skin"):
        assert any(where in each for each in told.removed), where


def test_metadata_can_be_kept(tmp_path: Path) -> None:
    stage_of(tmp_path / "geo.usda").Save()
    source = write_text(tmp_path / "s.usda", STUDIO, LAYER + "subLayers = [@./geo.usda@]")
    original = read_stage(source)
    told = write_flattened(original, moved(original), tmp_path / "out.usda", keep_metadata=True)
    assert told.removed == ()
    text = (tmp_path / "out.usda").read_text()
    for secret in SECRETS:
        assert secret in text, secret
    assert "body.usda" not in text  # A path to a layer leads to unmarked points.


def test_textures_outside_are_told_of(tmp_path: Path) -> None:
    (tmp_path / "tex").mkdir()
    (tmp_path / "tex" / "a.png").write_bytes(b"pixels")
    (tmp_path / "out").mkdir()
    stage = stage_of(tmp_path / "s.usda")
    prim = stage.GetPrimAtPath("/World")
    prim.CreateAttribute("tex", T.Asset).Set(Sdf.AssetPath(str(tmp_path / "tex" / "a.png")))
    stage.Save()
    original = read_stage(str(tmp_path / "s.usda"))
    told = write_flattened(original, moved(original), tmp_path / "out" / "o.usda")
    assert told.outside == ("../tex/a.png",)
    told = write_flattened(original, moved(original), tmp_path / "o.usda")
    assert told.outside == ()
