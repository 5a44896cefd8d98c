"""Normals turn as a mark turns the surface."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from meshmark.mesh.geometry import normalized, vertex_normals
from meshmark.usd.reading import read_stage
from meshmark.usd.writing import write_override
from rigged_stages import BENDS, Rigged, rotation, tube
from usd_sheets import (
    RNG,
    SLIDE,
    TIMES,
    F,
    Sheet,
    T,
    V,
    elements,
    value,
    vectors,
    written,
)
from usd_stages import read_one


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
