"""Moves taken from world space back into a prim's own: exact where nothing moved."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pxr import Usd

from meshmark.usd.reading import read_stage
from meshmark.usd.writing import write_override
from usd_stages import CUBE_POINTS, FRAMES, cube, points_at, sampled, write_text


@settings(max_examples=20)
@given(
    angles=st.tuples(*[st.floats(-180, 180)] * 3),
    scale=st.tuples(*[st.floats(0.01, 100)] * 3),
    shift=st.tuples(*[st.floats(-1000, 1000)] * 3),
)
def test_moves_return_to_local_space(
    tmp_path_factory: pytest.TempPathFactory,
    angles: tuple[float, ...],
    scale: tuple[float, ...],
    shift: tuple[float, ...],
) -> None:
    folder = tmp_path_factory.mktemp("xform")
    body = f"""
    def Xform "x"
    {{
        double3 xformOp:translate = {shift}
        double3 xformOp:rotateXYZ = {angles}
        double3 xformOp:scale = {scale}
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"]
        {cube(points=sampled(FRAMES))}
    }}
    """
    original = read_stage(write_text(folder / "a.usda", body))
    step = np.zeros((8, 3))
    step[3] = [0.25, -0.5, 0.125]
    mesh = original.meshes[0].map(lambda frame: frame.moved(frame.points + step))
    write_override(original, replace(original, meshes=(mesh,)), folder / "o.usdc")
    stage = Usd.Stage.Open(str(folder / "o.usdc"))
    again = read_stage(str(folder / "o.usdc")).meshes[0]
    for index, (time, points) in enumerate(FRAMES.items()):
        local = points_at(stage, "/x/cube", time)
        still = np.arange(8) != 3
        np.testing.assert_array_equal(local[still], points[still])
        size = np.abs(local[3]).max() * max(scale)
        np.testing.assert_allclose(
            again[index].points[3], mesh[index].points[3], rtol=0, atol=4e-7 * size
        )


def test_what_did_not_move_keeps_its_bits_in_spite_of_rounding(tmp_path: Path) -> None:
    # Zeros are where rounding shows: next to nothing added to zero is next to nothing.
    points = np.where(CUBE_POINTS == 0, np.float32(-0.0), CUBE_POINTS)
    body = f"""
    def Xform "x"
    {{
        double3 xformOp:rotateXYZ = (10, 20, 30)
        uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]
        {cube(points=sampled({1: points}))}
    }}
    """
    original = read_stage(write_text(tmp_path / "a.usda", body))
    noise = np.random.default_rng(0).uniform(-1e-15, 1e-15, (8, 3))
    mesh = original.meshes[0].map(lambda frame: frame.moved(frame.points + noise))
    write_override(original, replace(original, meshes=(mesh,)), tmp_path / "o.usdc")
    written = points_at(Usd.Stage.Open(str(tmp_path / "o.usdc")), "/x/cube", 1)
    assert written.tobytes() == points.tobytes()


def test_a_prim_squeezed_flat_moves_where_it_can(tmp_path: Path) -> None:
    body = f"""
    def Xform "flat"
    {{
        double3 xformOp:scale = (2, 1, 0)
        uniform token[] xformOpOrder = ["xformOp:scale"]
        {cube()}
    }}
    """
    original = read_stage(write_text(tmp_path / "a.usda", body))
    mesh = original.meshes[0].map(lambda frame: frame.moved(frame.points + 0.5))
    write_override(original, replace(original, meshes=(mesh,)), tmp_path / "o.usda")
    written = points_at(Usd.Stage.Open(str(tmp_path / "o.usda")), "/flat/cube")
    np.testing.assert_allclose(written, CUBE_POINTS + np.array([0.25, 0.5, 0]), atol=1e-6)
