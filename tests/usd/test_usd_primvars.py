"""What hangs on points that slid has the values of their new places, and nothing else changes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from meshmark.mesh.asset import Asset
from meshmark.mesh.geometry import normalized, vertex_normals
from meshmark.testing.meshes import icosphere, plane
from meshmark.usd.checking import check_stage
from meshmark.usd.delivery import write_flattened
from meshmark.usd.reading import read_stage
from meshmark.usd.writing import write_override
from rigged_stages import BENDS, Rigged, rotation, tube
from usd_stages import read_one

Write = Callable[..., object]
WRITERS = [write_override, write_flattened]
T = Sdf.ValueTypeNames
TIMES = (1.0, 2.0, 4.0)
V, F = plane(13)
INNER = np.all((V[:, :2] > 0) & (V[:, :2] < 1), axis=1)
# At most a seventh of an edge, and none at the border.
SLIDE = np.column_stack([np.sin(3 * V[:, 1] + 1), np.cos(4 * V[:, 0]), 0 * V[:, 0]]) * 0.012
SLIDE *= INNER[:, None]


def vectors(array: np.ndarray, kind: str = "Vec3f") -> object:
    dtype = {"h": np.float16, "f": np.float32, "d": np.float64}[kind[-1]]
    return getattr(Vt, f"{kind}Array").FromNumpy(np.ascontiguousarray(array, dtype=dtype))


class Sheet:
    """A stage with a mesh `/sheet`; by default a square that bulges with time."""

    def __init__(self, path: Path, points: Mapping[float, np.ndarray] | np.ndarray, faces=F):
        self.stage = Usd.Stage.CreateNew(str(path))
        self.mesh = UsdGeom.Mesh.Define(self.stage, "/sheet")
        if isinstance(points, np.ndarray):
            self.mesh.CreatePointsAttr(vectors(points))
        else:
            for time, each in points.items():
                self.mesh.CreatePointsAttr().Set(vectors(each), time)
        self.mesh.CreateFaceVertexCountsAttr([3] * len(faces))
        self.mesh.CreateFaceVertexIndicesAttr(faces.ravel().tolist())
        self.mesh.CreateSubdivisionSchemeAttr("none")

    def primvar(self, name: str, kind: Sdf.ValueTypeName, interpolation: str, value=None):
        made = UsdGeom.PrimvarsAPI(self.mesh).CreatePrimvar(name, kind, interpolation)
        if value is not None:
            made.Set(value)
        return made

    def save(self) -> str:
        self.stage.GetRootLayer().Save()
        return str(self.stage.GetRootLayer().realPath)


def flat(n: int = len(TIMES)) -> dict[float, np.ndarray]:
    """Show the square, moved on as a whole with time: barycentric coordinates stay."""
    return {time: V + index * np.eye(3)[2] for index, time in enumerate(TIMES[:n])}


def slid(asset: Asset, moves: Callable[[float], np.ndarray]) -> Asset:
    return replace(
        asset,
        meshes=tuple(
            mesh.map(lambda f: f.moved(f.points + moves(f.time))) for mesh in asset.meshes
        ),
    )


def written(source: str, write: Write, moves: Callable[[float], np.ndarray], **options: object):
    original = read_stage(source)
    # A layer that is open would not be read again.
    output = Path(source).with_name(f"out-{write.__name__}-{next(NUMBERS)}.usdc")
    write(original, slid(original, moves), output, **options)
    return Usd.Stage.Open(str(output))


def value(stage: Usd.Stage, name: str, time: float | None = None, prim: str = "/sheet"):
    attribute = stage.GetPrimAtPath(prim).GetAttribute(name)
    code = Usd.TimeCode.Default() if time is None else time
    primvar = UsdGeom.Primvar(attribute)
    return np.array(primvar.ComputeFlattened(code) if primvar else attribute.Get(code))


def growing(time: float) -> np.ndarray:
    return SLIDE * (time - 1)


NUMBERS = count()
RNG = np.random.default_rng(0)
PAIRS = RNG.random((len(V), 2))


def elements(interpolation: str) -> np.ndarray:
    """Return the vertex of each element of the square."""
    return F.ravel() if interpolation == "faceVarying" else np.arange(len(V))


@pytest.mark.parametrize("interpolation", ["vertex", "varying", "faceVarying"])
def test_on_a_plane_coordinates_are_the_new_place(tmp_path: Path, interpolation: str) -> None:
    sheet, rows = Sheet(tmp_path / "s.usda", flat()), elements(interpolation)
    sheet.primvar("st", T.TexCoord2fArray, interpolation, vectors(V[rows, :2], "Vec2f"))
    sheet.primvar("squares", T.Float3Array, interpolation, vectors(V[rows] ** 2))
    out = written(sheet.save(), write_override, growing)
    for time in TIMES:
        place = (V + growing(time))[rows, :2]
        np.testing.assert_allclose(value(out, "primvars:st", time), place, atol=1e-6)
        # Linear interpolation errs by at most the square of half an edge in each direction.
        squares = value(out, "primvars:squares", time)[:, :2]
        np.testing.assert_allclose(squares, place**2, atol=1 / 24**2 + 1e-6)
    attribute = out.GetPrimAtPath("/sheet").GetAttribute("primvars:st")
    assert attribute.GetTimeSamples() == [*TIMES]
    mean = V[:, :2] + SLIDE[:, :2] * 4 / 3
    np.testing.assert_allclose(value(out, "primvars:st"), mean[rows], atol=1e-6)


def test_a_slide_that_stays_the_same_needs_no_samples(tmp_path: Path) -> None:
    sheet = Sheet(tmp_path / "s.usda", flat())
    sheet.primvar("st", T.TexCoord2fArray, "vertex", vectors(V[:, :2], "Vec2f"))
    # A twentieth of the slide comes and goes.
    out = written(sheet.save(), write_override, lambda t: SLIDE * (1 + 0.05 * (-1) ** int(t)))
    assert not out.GetPrimAtPath("/sheet").GetAttribute("primvars:st").GetTimeSamples()
    found = value(out, "primvars:st", 2)
    np.testing.assert_allclose(found, (V + SLIDE)[:, :2], atol=0.05 * np.abs(SLIDE).max())


@pytest.mark.parametrize("interpolation", ["vertex", "faceVarying"])
@pytest.mark.parametrize("indexed", [False, True])
@pytest.mark.parametrize("n_times", [1, 3])
def test_a_deliverable_holds_what_the_layer_shows(
    tmp_path: Path, interpolation: str, indexed: bool, n_times: int
) -> None:
    sheet, rows = Sheet(tmp_path / "s.usda", flat(n_times)), elements(interpolation)
    primvar = sheet.primvar("st", T.TexCoord2fArray, interpolation)
    if indexed:
        # Values are listed backwards, and one of them twice.
        table = np.concatenate([PAIRS[::-1], PAIRS[:1]])
        primvar.Set(vectors(table, "Vec2f"))
        primvar.SetIndices(Vt.IntArray((len(V) - 1 - rows).tolist()))
    else:
        primvar.Set(vectors(PAIRS[rows], "Vec2f"))
    sheet.primvar("one", T.Color3fArray, "constant", vectors(np.ones((1, 3))))
    source = sheet.save()
    over, delivered = (written(source, write, lambda t: SLIDE * t) for write in WRITERS)
    for time in TIMES[:n_times]:
        found = value(over, "primvars:st", time)
        np.testing.assert_array_equal(found, value(delivered, "primvars:st", time))
        moved = INNER[rows]
        assert np.all(np.any(found[moved] != PAIRS[rows][moved].astype(np.float32), axis=1))
        np.testing.assert_array_equal(found[~moved], PAIRS[rows][~moved].astype(np.float32))
    # The original's own values are gone, not only hidden.
    layer = delivered.GetRootLayer()
    spec = layer.GetAttributeAtPath("/sheet.primvars:st")
    samples = layer.ListTimeSamplesForPath(spec.path)
    assert samples == list(TIMES[: n_times if n_times > 1 else 0])
    for held in (spec.default, *(layer.QueryTimeSample(spec.path, time) for time in samples)):
        assert not np.array_equal(np.array(held)[: len(PAIRS)], PAIRS[: len(held)])
    assert check_stage(layer.realPath) == []


@pytest.mark.parametrize("kind", ["Half", "Float", "Double"])
def test_types_stay(tmp_path: Path, kind: str) -> None:
    sheet = Sheet(tmp_path / "s.usda", V)
    array = getattr(Vt, f"{kind}Array").FromNumpy(
        np.asarray(V[:, 0], dtype={"Half": "f2", "Float": "f4", "Double": "f8"}[kind])
    )
    sheet.primvar("x", getattr(T, f"{kind}Array"), "vertex", array)
    sheet.primvar("pairs", T.Float2Array, "vertex", vectors(np.tile(V[:, :2], 2), "Vec2f"))
    out = written(sheet.save(), write_override, lambda _: SLIDE)
    found = out.GetPrimAtPath("/sheet").GetAttribute("primvars:x")
    assert found.GetTypeName() == getattr(T, f"{kind}Array")
    atol = 1e-3 if kind == "Half" else 1e-6
    np.testing.assert_allclose(np.array(found.Get()), (V + SLIDE)[:, 0], atol=atol)


def test_what_is_no_interpolated_float_stays_to_the_bit(tmp_path: Path) -> None:
    sheet = Sheet(tmp_path / "s.usda", flat())
    n, bad = len(V), np.full((len(V), 2), np.nan)
    names = ["ab"[i % 2] * i for i in range(n)]
    sheet.primvar("ids", T.IntArray, "vertex", Vt.IntArray(RNG.permutation(n).tolist()))
    sheet.primvar("on", T.BoolArray, "vertex", Vt.BoolArray([True, False] * (n // 2) + [True]))
    sheet.primvar("names", T.StringArray, "vertex", Vt.StringArray(names))
    sheet.primvar("kinds", T.TokenArray, "vertex", Vt.TokenArray(names))
    sheet.primvar("turns", T.QuatfArray, "vertex", Vt.QuatfArray([Gf.Quatf(1)] * n))
    sheet.primvar("tint", T.Color3fArray, "uniform", vectors(RNG.random((len(F), 3))))
    sheet.primvar("few", T.FloatArray, "vertex", Vt.FloatArray([1, 2, 3]))
    sheet.primvar("bad", T.TexCoord2fArray, "vertex", vectors(bad, "Vec2f"))
    sheet.primvar("same", T.Color3fArray, "vertex", vectors(np.full((n, 3), 0.3)))
    sheet.primvar(
        "skel:jointWeights", T.FloatArray, "vertex", Vt.FloatArray(RNG.random(n).tolist())
    )
    mesh = sheet.mesh
    mesh.CreateCreaseIndicesAttr([0, 1, 2, 14])
    mesh.CreateCreaseLengthsAttr([2, 2])
    mesh.CreateCreaseSharpnessesAttr([1.5, 3])
    mesh.CreateCornerIndicesAttr([5])
    mesh.CreateCornerSharpnessesAttr([2])
    UsdGeom.Subset.CreateGeomSubset(mesh, "part", "face", Vt.IntArray([3, 4, 5]))
    source = sheet.save()
    before = Usd.Stage.Open(source)
    for write in WRITERS:
        after = written(source, write, growing)
        for prim in before.TraverseAll():
            for attribute in prim.GetAuthoredAttributes():
                if attribute.GetName() in ("points", "extent"):
                    continue
                other = after.GetAttributeAtPath(attribute.GetPath())
                assert str(attribute.Get()) == str(other.Get()), attribute.GetPath()
                assert attribute.GetTimeSamples() == other.GetTimeSamples()
    stage = written(source, write_override, growing)
    layer = stage.GetRootLayer()
    assert {spec.name for spec in layer.GetPrimAtPath("/sheet").properties} == {"points", "extent"}


def test_animated_values_keep_their_times(tmp_path: Path) -> None:
    sheet = Sheet(tmp_path / "s.usda", flat())
    primvar = sheet.primvar("st", T.TexCoord2fArray, "faceVarying")
    scroll = {0.5: 0.0, 1.0: 0.1, 3.0: 0.2, 5.0: 0.7}
    for time, shift in scroll.items():
        primvar.Set(vectors(V[F.ravel(), :2] + shift, "Vec2f"), time)
    source = sheet.save()
    for moves, expected in ((growing, [0.5, 1, 2, 3, 4, 5]), (lambda _: 0 * V, [*scroll])):
        out = written(source, write_override, moves)
        attribute = out.GetPrimAtPath("/sheet").GetAttribute("primvars:st")
        assert attribute.GetTimeSamples() == expected
    out = written(source, write_override, growing)
    # What is sampled between two frames goes with the first of them.
    slides = {0.5: 1, 1: 1, 2: 2, 3: 2, 4: 4, 5: 4}
    for time, frame in slides.items():
        shift = np.interp(time, [*scroll], [*scroll.values()])
        place = (V + growing(frame))[F.ravel(), :2] + shift
        np.testing.assert_allclose(value(out, "primvars:st", time), place, atol=1e-6)


def test_values_of_a_still_mesh_may_be_animated(tmp_path: Path) -> None:
    sheet = Sheet(tmp_path / "s.usda", V)
    primvar = sheet.primvar("heat", T.FloatArray, "vertex")
    for time in (1, 2):
        primvar.Set(Vt.FloatArray((time * V[:, 0]).tolist()), time)
    out = written(sheet.save(), write_flattened, lambda _: SLIDE)
    for time in (1, 2):
        expected = time * (V + SLIDE)[:, 0]
        np.testing.assert_allclose(value(out, "primvars:heat", time), expected, atol=1e-6)


def test_a_seam_of_a_sphere_mixes_no_charts(tmp_path: Path) -> None:
    P, faces = icosphere(3)
    P = P @ np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    faces = faces[np.abs(P[faces][..., 2]).max(axis=1) < 0.9]
    u = np.arctan2(P[:, 1], P[:, 0])[faces] / (2 * np.pi)
    u = np.where(u < u.max(axis=1, keepdims=True) - 0.5, u + 1.0, u)
    uv = np.stack([u, P[faces][..., 2]], axis=2).reshape(-1, 2)
    sheet = Sheet(tmp_path / "s.usda", P, faces)
    sheet.primvar("st", T.TexCoord2fArray, "faceVarying", vectors(uv, "Vec2f"))
    angle = 3.0
    turn = P @ rotation((0, 0, 1), angle) - P
    out = written(sheet.save(), write_override, lambda _: turn)
    change = value(out, "primvars:st") - uv
    np.testing.assert_allclose(np.abs(change[:, 0]), angle / 360, atol=2e-3)
    np.testing.assert_allclose(change[:, 1], 0, atol=0.015)


def test_coordinates_of_a_rest_pose_follow_it(tmp_path: Path) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    mesh = rigged.add_tube()
    x = tube()[0][:, 0]
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", T.TexCoord2fArray, "vertex")
    st.Set(vectors(np.stack([x, 0 * x], axis=1), "Vec2f"))
    rigged.turn_elbow(BENDS)
    original = read_stage(rigged.save())
    middle = (x > 0.1) & (x < 1.9)

    def along(frame):
        turned = np.array([1, 0, 0]) @ rotation((0, 0, 1), BENDS[frame.time])
        far, near = (x > 1.3)[:, None] * turned, (x < 0.7)[:, None] * np.eye(3)[0]
        return frame.moved(frame.points + 0.02 * (far + near) * middle[:, None])

    marked = replace(original, meshes=tuple(each.map(along) for each in original.meshes))
    stiff = middle & ((x > 1.3) | (x < 0.7))
    for skel in ("bake", "rest"):
        for write in WRITERS:
            output = tmp_path / f"{skel}-{write.__name__}.usda"
            write(original, marked, output, skel=skel)
            shown = Usd.Stage.Open(str(output))
            for time in BENDS:
                found = value(shown, "primvars:st", time, "/man/arm")[:, 0]
                np.testing.assert_allclose(found[stiff], x[stiff] + 0.02, atol=1e-5)
            weights = value(shown, "primvars:skel:jointWeights", prim="/man/arm")
            expected = mesh.GetPrim().GetAttribute("primvars:skel:jointWeights").Get()
            np.testing.assert_array_equal(weights, np.array(expected))
            attribute = shown.GetPrimAtPath("/man/arm").GetAttribute("primvars:st")
            assert attribute.GetTimeSamples() == []


def test_instances_follow_in_a_deliverable(tmp_path: Path) -> None:
    sheet = Sheet(tmp_path / "s.usda", V)
    sheet.primvar("st", T.TexCoord2fArray, "vertex", vectors(PAIRS, "Vec2f"))
    sheet.stage.SetDefaultPrim(sheet.mesh.GetPrim())
    inner = sheet.save()
    stage = Usd.Stage.CreateNew(str(tmp_path / "two.usda"))
    for name in "ab":
        prim = stage.DefinePrim(f"/{name}")
        held = stage.DefinePrim(f"/{name}/sheet")
        held.GetReferences().AddReference(inner)
        prim.SetInstanceable(True)
    model = stage.DefinePrim("/model/sheet")
    model.GetReferences().AddReference(inner)
    for name in ("c", "d"):
        prim = stage.DefinePrim(f"/{name}")
        prim.GetReferences().AddInternalReference("/model")
        prim.SetInstanceable(True)
    stage.GetRootLayer().Save()
    original = read_stage(str(tmp_path / "two.usda"))
    proxies = [mesh.prim for mesh in original.meshes if not mesh.in_place]
    assert proxies
    signs = {prim: 1 + index for index, prim in enumerate(proxies)}
    meshes = tuple(
        mesh.map(lambda f, k=signs[mesh.prim]: f.moved(f.points + k / 4 * SLIDE))
        for mesh in original.meshes
        if mesh.prim in signs
    )
    write_flattened(original, replace(original, meshes=meshes), tmp_path / "o.usda")
    out = Usd.Stage.Open(str(tmp_path / "o.usda"))
    found = [value(out, "primvars:st", prim=prim) for prim in proxies]
    assert all(np.any(each != PAIRS.astype(np.float32)) for each in found)
    assert np.any(found[0] != found[1])


@pytest.mark.parametrize("shaped", [False, True])
def test_what_variants_say_is_theirs(tmp_path: Path, shaped: bool) -> None:
    sheet = Sheet(tmp_path / "s.usda", V)
    sheet.primvar("heat", T.FloatArray, "vertex", Vt.FloatArray(V[:, 0].tolist()))
    looks = sheet.mesh.GetPrim().GetVariantSets().AddVariantSet("look")
    for index, name in enumerate(("plain", "scaled")):
        looks.AddVariant(name)
        looks.SetVariantSelection(name)
        with looks.GetVariantEditContext():
            sheet.primvar("st", T.TexCoord2fArray, "vertex", vectors(V[:, :2] + index, "Vec2f"))
            if shaped:
                sheet.mesh.GetPointsAttr().Set(vectors(V * (1 + index)))
    if shaped:
        sheet.mesh.GetPrim().RemoveProperty("points")
    looks.SetVariantSelection("plain")
    out = written(sheet.save(), write_override, lambda _: SLIDE)
    moved = (V + SLIDE)[:, :2]
    # What is said for all shapes is stronger than anything inside the variant of one.
    heat = V[:, 0] if shaped else moved[:, 0]
    np.testing.assert_allclose(value(out, "primvars:heat"), heat, atol=1e-6)
    # The points are those of both looks, and so would be what hangs on them.
    expected = moved if shaped else V[:, :2]
    np.testing.assert_allclose(value(out, "primvars:st"), expected, atol=1e-6)
    out.GetPrimAtPath("/sheet").GetVariantSet("look").SetVariantSelection("scaled")
    np.testing.assert_allclose(value(out, "primvars:st"), V[:, :2] + 1, atol=1e-6)
    delivered = written(sheet.stage.GetRootLayer().realPath, write_flattened, lambda _: SLIDE)
    assert value(delivered, "primvars:st").shape == (len(V), 2)


def test_a_reference_pose_goes_with_the_points_in_a_deliverable(tmp_path: Path) -> None:
    P, faces = icosphere(3)
    P = P * [1, 1.3, 1.7] + 0.2 * np.sin(3 * P[:, ::-1])
    sheet = Sheet(tmp_path / "s.usda", P, faces)
    sheet.primvar("Pref", T.Point3fArray, "vertex", vectors(P))
    moves = RNG.normal(0, 3e-3, P.shape)
    out = written(sheet.save(), write_flattened, lambda _: moves)
    np.testing.assert_allclose(value(out, "primvars:Pref"), P + moves, atol=1e-6)
    assert check_stage(out.GetRootLayer().realPath) == []
    # A layer shows each vertex where it was on the old surface.
    over = written(sheet.stage.GetRootLayer().realPath, write_override, lambda _: moves)
    off = value(over, "primvars:Pref") - (P + moves)
    assert 0 < np.linalg.norm(off, axis=1).mean() < np.linalg.norm(moves, axis=1).mean()


def test_keep_writes_points_and_nothing_else(tmp_path: Path) -> None:
    sheet = Sheet(tmp_path / "s.usda", flat())
    sheet.primvar("st", T.TexCoord2fArray, "vertex", vectors(PAIRS, "Vec2f"))
    for write in WRITERS:
        out = written(sheet.save(), write, growing, primvars="keep")
        for time in TIMES:
            np.testing.assert_array_equal(value(out, "primvars:st", time), np.float32(PAIRS))


def bulge(time: float) -> np.ndarray:
    """Return the square bent into a piece of a sphere, ever more."""
    P = V - [0.5, 0.5, 0]
    return np.column_stack([P[:, :2], np.sqrt((6 - time) ** 2 - (P[:, :2] ** 2).sum(axis=1))])


@pytest.mark.parametrize("interpolation", ["vertex", "faceVarying"])
@pytest.mark.parametrize("name", ["normals", "primvars:normals"])
def test_normals_of_the_faces_about_a_point_stay_that(
    tmp_path: Path, interpolation: str, name: str
) -> None:
    frames, rows = {time: bulge(time) for time in TIMES}, elements(interpolation)
    sheet = Sheet(tmp_path / "s.usda", frames)
    sheet.mesh.SetNormalsInterpolation(interpolation)
    for time, P in frames.items():
        normals = vectors(vertex_normals(P, F)[rows])
        if name == "normals":
            sheet.mesh.CreateNormalsAttr().Set(normals, time)
        else:
            sheet.primvar("normals", T.Normal3fArray, interpolation).Set(normals, time)
    moves = SLIDE + RNG.normal(0, 2e-3, V.shape)
    out = written(sheet.save(), write_override, lambda time: time * moves)
    for time, P in frames.items():
        expected = vertex_normals(P + time * moves, F)[rows]
        np.testing.assert_allclose(value(out, name, time), expected, atol=1e-5)
    assert out.GetPrimAtPath("/sheet").GetAttribute(name).GetTimeSamples() == [*TIMES]


def test_normals_turn_with_the_surface(tmp_path: Path) -> None:
    sheet = Sheet(tmp_path / "s.usda", V)
    # Shading normals that lean by themselves go on leaning.
    lean = normalized(np.tile([0.3, 0.1, 1.0], (len(V), 1)))
    sheet.mesh.CreateNormalsAttr(vectors(lean))
    sheet.mesh.SetNormalsInterpolation("vertex")
    tilt = V @ rotation((0, 1, 0), 4) - V
    out = written(sheet.save(), write_override, lambda _: tilt)
    expected = lean @ rotation((0, 1, 0), 4)
    np.testing.assert_allclose(value(out, "normals"), expected, atol=1e-5)


@pytest.mark.parametrize("name", ["normals", "primvars:normals"])
def test_baked_normals_are_those_of_the_rig_where_nothing_moved(tmp_path: Path, name: str) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    mesh = rigged.add_tube()
    out = tube()[0] * [0, 5, 5]
    made = (
        mesh.CreateNormalsAttr()
        if name == "normals"
        else UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("normals", T.Normal3fArray, "vertex")
    )
    made.Set(vectors(out))
    mesh.SetNormalsInterpolation("vertex")
    rigged.turn_elbow(BENDS)
    original = read_stage(rigged.save())
    write_override(original, original, tmp_path / "o.usda")
    shown = Usd.Stage.Open(str(tmp_path / "o.usda"))
    for time, angle in BENDS.items():
        far = tube()[0][:, 0] > 1.3
        expected = out[far] @ rotation((0, 0, 1), angle)
        np.testing.assert_allclose(value(shown, name, time, "/man/arm")[far], expected, atol=1e-5)
    assert read_one(str(tmp_path / "o.usda")).notes == ()
