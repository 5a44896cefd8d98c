"""Velocities and accelerations are those of the marked points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from meshmark.usd.velocities import derivatives
from meshmark.usd.writing import write_override
from usd_sheets import PAIRS, SLIDE, WRITERS, F, Sheet, T, V, flat, growing, value, vectors, written


@pytest.mark.parametrize("write", WRITERS)
def test_velocities_and_accelerations_are_those_of_the_marked_points(tmp_path, write) -> None:
    times = [1.0, 2.0, 2.5, 4.0, 7.0]
    # Metres a second, at 24 frames a second: x falls, z is still.
    fall = {t: V + np.array([1.0, 0.0, 0.0]) * 3 * (t / 24) ** 2 for t in times}
    sheet = Sheet(tmp_path / "s.usda", fall)
    sheet.stage.SetTimeCodesPerSecond(24)
    for t in times:
        along = np.tile([6 * t / 24, 0, 0], (len(V), 1))
        sheet.mesh.CreateVelocitiesAttr().Set(vectors(along), t)
    sheet.mesh.CreateAccelerationsAttr(vectors(np.tile([6.0, 0, 0], (len(V), 1))))
    # A move that a parabola describes: its derivatives are exact.
    out = written(sheet.save(), write, lambda t: SLIDE * (0.5 * t - 0.1 * t**2))
    for t in times:
        velocity = [6 * t / 24, 0, 0] + SLIDE * (0.5 - 0.2 * t) * 24
        np.testing.assert_allclose(value(out, "velocities", t), velocity, atol=2e-4)
        acceleration = [6, 0, 0] - SLIDE * 0.2 * 24**2
        np.testing.assert_allclose(value(out, "accelerations", t), acceleration, atol=2e-2)
    for name in ("velocities", "accelerations"):
        assert out.GetPrimAtPath("/sheet").GetAttribute(name).GetTimeSamples() == times


def test_velocities_of_a_move_that_stays_do_not_change(tmp_path: Path) -> None:
    sheet = Sheet(tmp_path / "s.usda", flat())
    sheet.mesh.CreateVelocitiesAttr(vectors(np.ones_like(V)))
    sheet.mesh.CreateAccelerationsAttr(vectors(np.ones((3, 3))))
    for moves in (lambda _: 0 * V, lambda t: SLIDE * t):
        out = written(sheet.save(), write_override, moves)
        assert value(out, "accelerations", 1).tolist() == np.ones((3, 3)).tolist()
        spec = out.GetRootLayer().GetAttributeAtPath("/sheet.velocities")
        assert (spec is None) == (not np.any(moves(1)))


def test_derivatives_of_two_samples_are_those_of_a_line() -> None:
    rows = list(derivatives([(1.0, np.array([1.0, 2])), (3.0, np.array([2.0, 2]))]))
    assert [time for time, _, _ in rows] == [1.0, 3.0]
    for _, first, second in rows:
        assert first.tolist() == [0.5, 0.0]
        assert second.tolist() == [0.0, 0.0]


def test_other_faces_at_other_times_leave_all_as_it_is(tmp_path: Path) -> None:
    sheet = Sheet(tmp_path / "s.usda", flat())
    sheet.mesh.CreateVelocitiesAttr(vectors(np.ones_like(V)))
    sheet.primvar("st", T.TexCoord2fArray, "vertex", vectors(PAIRS, "Vec2f"))
    indices = sheet.mesh.GetFaceVertexIndicesAttr()
    for time, faces in ((1.0, F), (2.0, F[::-1])):
        indices.Set(faces.ravel().tolist(), time)
    out = written(sheet.save(), write_override, growing)
    names = {spec.name for spec in out.GetRootLayer().GetPrimAtPath("/sheet").properties}
    assert names == {"points", "extent"}
