"""Parts as face subsets and colours that USD accepts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from meshmark.errors import UsageError
from meshmark.usd.parts import palette, write_parts
from meshmark.usd.reading import read_stage
from usd_stages import CUBE_POINTS, FRAMES, cube, points_at, sampled, write_text


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
