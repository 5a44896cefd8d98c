"""What hangs on points that slid has the values of their new places, and nothing else changes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, Vt

from meshmark.embedding.asset import embed
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key
from meshmark.metrics.texture import Texture
from meshmark.testing.meshes import icosphere
from meshmark.usd.checking import check_stage
from meshmark.usd.delivery import write_flattened
from meshmark.usd.reading import read_stage
from meshmark.usd.texture_coordinates import TextureCoordinates
from meshmark.usd.writing import write_override
from rigged_stages import BENDS, Rigged, rotation, tube
from usd_sheets import (
    INNER,
    PAIRS,
    RNG,
    SLIDE,
    TIMES,
    WRITERS,
    F,
    Sheet,
    T,
    V,
    elements,
    flat,
    growing,
    slid,
    value,
    vectors,
    written,
)


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


def test_frames_that_are_not_marked_keep_their_bits(tmp_path: Path) -> None:
    sheet = Sheet(tmp_path / "s.usda", flat())
    sheet.primvar("st", T.TexCoord2fArray, "faceVarying", vectors(PAIRS[F.ravel()], "Vec2f"))
    original = read_stage(sheet.save())
    marked = slid(original, lambda _: SLIDE)
    one = replace(marked, meshes=(marked.meshes[0].select([1]),))
    write_override(original, one, tmp_path / "o.usda")
    out = Usd.Stage.Open(str(tmp_path / "o.usda"))
    for time in TIMES:
        same = value(out, "primvars:st", time) == PAIRS[F.ravel()].astype(np.float32)
        assert same.all() == (time != TIMES[1])


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
    proxies = [mesh.prim for mesh in original.meshes if mesh.shared]
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


def drift_of(source: str, output: Path, prim: str) -> tuple[float, float]:
    """Measure how far textures slide with the coordinates of a source, and with those written."""
    before, after = read_stage(source, [prim]).meshes[0], read_stage(str(output), [prim]).meshes[0]
    coordinates = [TextureCoordinates(file, prim) for file in (source, str(output))]
    kept, followed = Texture(coordinates[0]), Texture(*coordinates)
    found = []
    for one, other in zip(before, after, strict=True):
        frames = (one.points, other.points, one.faces)
        found.append([each.largest_drift(one.time, *frames) for each in (kept, followed)])
    keep, follow = np.mean(found, axis=0).tolist()
    return keep, follow


@pytest.mark.parametrize("write", WRITERS)
def test_textures_of_a_real_sphere_of_quads_stay(data_folder: Path, tmp_path, write) -> None:
    source, prim = str(data_folder / "usd" / "points-sphere.usda"), "/pSphere1"
    original = read_stage(source)

    def turned(frame):
        # About the middle, a little farther in every frame.
        angle = 0.3 + 0.02 * frame.time
        middle = frame.points.mean(axis=0)
        return frame.moved((frame.points - middle) @ rotation((0, 0, 1), angle) + middle)

    marked = replace(original, meshes=tuple(mesh.map(turned) for mesh in original.meshes))
    write(original, marked, tmp_path / "o.usdc")
    keep, follow = drift_of(source, tmp_path / "o.usdc", prim)
    assert keep > 1
    assert follow < 0.1 * keep


@pytest.mark.slow
@pytest.mark.parametrize("skel", ["bake", "rest"])
def test_textures_of_a_real_rig_stay(data_folder: Path, tmp_path: Path, skel: str) -> None:
    source = str(data_folder / "usd" / "CesiumMan.usdz")
    original = read_stage(source)
    marked = embed(original, Key(bytes(32)), recipe=Recipe("apex")).asset
    for write in WRITERS:
        output = tmp_path / f"{write.__name__}.usdc"
        write(original, marked, output, skel=skel)
        keep, follow = drift_of(source, output, original.meshes[0].prim)
        assert keep > 20
        # One value cannot serve all poses quite: between points, these are not linear.
        assert follow < (0.1 if skel == "bake" else 0.3) * keep
        stage = Usd.Stage.Open(str(output))
        prim = stage.GetPrimAtPath(original.meshes[0].prim)
        assert len(prim.GetAttribute("primvars:st").GetTimeSamples()) == 48 * (skel == "bake")
    assert check_stage(str(output)) == []
