"""Points far from the origin are rounded, and a mark with them: foreseen, not found at the end."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from meshmark import mark_file
from meshmark.cli import main
from meshmark.commands.inspect import inspect_asset
from meshmark.embedding.asset import embed
from meshmark.errors import CapacityError
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.precision import rounding, rounding_of
from meshmark.sources.reading import read
from meshmark.testing.attacks import sphere
from meshmark.testing.schemas import schema_folder

KEY = Key(bytes(range(32)))
RECIPE = Recipe("cho2007")
V, F = sphere(600)
# Lumps, or all distances from the centre were the same.
V *= 1 + 0.2 * np.sin(5 * V)
DIAGONAL = float(np.linalg.norm(np.ptp(V, axis=0)))
FAR = np.array([5e6, 5e6, 5e6])
# Single precision there: steps of 1/256, just above a thousandth of the diagonal.
DISTANT = np.full(3, 5e4)
KINDS = {
    "float3": (np.float32, Sdf.ValueTypeNames.Point3fArray, Vt.Vec3fArray),
    "double3": (np.float64, Sdf.ValueTypeNames.Double3Array, Vt.Vec3dArray),
}


def stage(path: Path, kind: str, offset: np.ndarray, shift: np.ndarray | None = None) -> str:
    """Write the sphere at an offset, in points of a type, below a transform by `shift`."""
    made = Usd.Stage.CreateNew(str(path))
    mesh = UsdGeom.Mesh.Define(made, "/ball")
    dtype, value, array = KINDS[kind]
    spec = Sdf.AttributeSpec(made.GetRootLayer().GetPrimAtPath("/ball"), "points", value)
    spec.default = array.FromNumpy((V + offset).astype(dtype))
    mesh.CreateFaceVertexCountsAttr([3] * len(F))
    mesh.CreateFaceVertexIndicesAttr(F.reshape(-1).tolist())
    if shift is not None:
        mesh.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*shift.tolist()))
    made.Save()
    return str(path)


def obj(path: Path, offset: np.ndarray) -> str:
    """Write the sphere in more digits than single precision has."""
    lines = [f"v {x:.12f} {y:.12f} {z:.12f}" for x, y, z in (V + offset).tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (F + 1).tolist()]
    path.write_text("\n".join(lines) + "\n")
    return str(path)


@pytest.mark.parametrize(
    ("dtype", "offset", "step"),
    [
        (np.float32, [5e6, 5e6, 5e6], 0.5),
        (np.float32, [-5e6, 5e6, -5e6], 0.5),
        (np.float64, [5e6, 5e6, 5e6], 2.0**-30),
        (np.float16, [1500, 1500, 1500], 1.0),
        (np.float32, [5e6, 0, 0], 0.5 / np.sqrt(3)),
    ],
)
def test_the_step_is_that_of_the_type_at_that_distance(
    dtype: type, offset: list[float], step: float
) -> None:
    stored = (8 * V + offset).astype(dtype)
    diagonal = np.linalg.norm(np.ptp(stored.astype(np.float64), axis=0))
    assert rounding(stored, F) == pytest.approx(step / diagonal, rel=1e-6)


def test_near_the_origin_it_is_nothing_and_without_extent_unknown() -> None:
    assert 0 < rounding(V.astype(np.float32), F) < 1e-7
    assert rounding(0 * V, F) is None


@pytest.mark.parametrize("isolated", [False, True])
def test_a_transform_and_double_precision_lose_nothing(tmp_path: Path, isolated: bool) -> None:
    for name, kind, offset, shift, least, most in (
        ("far", "float3", FAR, None, 0.1, 0.2),
        ("under", "float3", 0 * FAR, FAR, 0, 1e-7),
        ("back", "float3", FAR, -FAR, 0.1, 0.2),
        ("double", "double3", FAR, None, 0, 1e-9),
    ):
        source = stage(tmp_path / f"{name}.usdc", kind, offset, shift)
        (mesh,) = read(source, isolated=isolated).meshes
        found = rounding_of(mesh, mesh[0])
        assert least <= found <= most, name


@pytest.mark.parametrize("make", ["usd", "obj", "moved back"])
def test_a_mark_that_would_be_lost_is_refused_before_the_work(
    tmp_path: Path,
    make: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if make == "obj":
        source, output = obj(tmp_path / "a.obj", FAR), tmp_path / "out.obj"
    else:
        shift = -FAR if make == "moved back" else None
        source, output = stage(tmp_path / "a.usdc", "float3", FAR, shift), tmp_path / "out.usdc"
    told = r"float32 rounds its points to 0\.5, and a mark needs 0\.03; move the mesh to the origin"
    started: list[object] = []
    with pytest.raises(CapacityError, match=told) as caught:
        mark_file(source, output, KEY, recipe=RECIPE, progress=lambda *at: started.append(at))
    assert caught.value.exit_code == 3
    assert not started
    assert not output.exists()
    document = inspect_asset(read(source), RECIPE)
    schema = json.loads((schema_folder("json") / "inspect.schema.json").read_text())
    jsonschema.validate(document, schema)
    assert not document["prims"][0]["can_hold"]
    assert "float32 rounds its points to 0.5" in document["prims"][0]["reason"]
    monkeypatch.setattr("sys.argv", ["meshmark", "inspect", source, "--scheme", "cho2007"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 1
    assert "store points as double3" in capsys.readouterr().out


def test_a_mark_that_is_weakened_is_warned_of(tmp_path: Path) -> None:
    mesh = MeshAnimation.from_arrays(V + DISTANT, F)
    found = inspect_asset(Asset("x", (mesh,), "memory"), RECIPE)["prims"][0]
    assert found["can_hold"], found["reason"]
    (note,) = found["notes"]
    assert "float32 rounds its points to 0.004, and a mark suffers beyond 0.003" in note
    assert embed(mesh, KEY, recipe=RECIPE).meshes[0].animation.notes == (note,)
    exact = replace(mesh, dtype="float64")
    assert not inspect_asset(Asset("x", (exact,), "memory"), RECIPE)["prims"][0]["notes"]


@pytest.mark.parametrize("how", ["double3", "transform"])
def test_layouts_settle_on_what_will_be_stored(how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """World positions were rounded to single precision, whatever the type and the transform."""
    scheme = type(RECIPE.build().binned)
    seen: list[Frame] = []
    layout = scheme.layout
    monkeypatch.setattr(scheme, "layout", lambda self, f: seen.append(f) or layout(self, f))

    def moves(mesh: MeshAnimation) -> np.ndarray:
        seen.clear()
        embed(mesh, KEY, recipe=RECIPE)
        return seen[1].points - seen[0].points

    near = MeshAnimation.from_arrays(V, F)
    # A power of two: double precision then adds and subtracts without a trace in 30 bits.
    far = MeshAnimation.from_arrays(V + 2.0**22, F)
    far = replace(far, dtype="float64") if how == "double3" else replace(far, rounding=1e-8)
    expected = moves(near)
    assert np.abs(expected).max() > 1e-4
    np.testing.assert_allclose(moves(far), expected, atol=1e-5)
