from __future__ import annotations

import numpy as np
import pytest

from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.geometry import surface_box
from meshmark.testing.attacks import AttackSuite, bending_ball, sphere
from meshmark_plugins.attacks import RECORDS

RECORD = {record.name: record for record in RECORDS}["bending"]


class TestBending(AttackSuite):
    @pytest.fixture
    def record(self):
        return RECORD


class TestCubicBendingOfEachFrame(TestBending):
    @pytest.fixture
    def parameters(self):
        return {"degree": 3, "per": "frame"}


def bent(animation, seed=0, **parameters):
    attacked = RECORD.factory(**parameters).apply(animation, np.random.default_rng(seed))
    return [after.points - before.points for before, after in zip(animation, attacked, strict=True)]


@pytest.mark.parametrize("degree", [2, 3])
@pytest.mark.parametrize("amount", [0.01, 0.03])
def test_the_largest_displacement_is_the_share_of_the_diagonal(amount, degree):
    ball = bending_ball()
    for frame, D in zip(ball, bent(ball, amount=amount, degree=degree), strict=True):
        size = amount * surface_box(frame.points, frame.faces)[0]
        assert np.linalg.norm(D, axis=1).max() == pytest.approx(size, rel=1e-9)


@pytest.mark.parametrize("degree", [2, 3])
@pytest.mark.parametrize("seed", range(5))
def test_all_move_along_a_line_by_a_power_of_the_place_across_it(degree, seed):
    V, F = sphere(2000)
    [D] = bent(MeshAnimation.from_arrays(5.0 * V + 7.0, F), seed, amount=0.02, degree=degree)
    across = np.linalg.svd(D)[2][0]
    np.testing.assert_allclose(D, np.outer(D @ across, across), atol=1e-12)
    # The sphere's places along the axis are -1 to 1, and the power determines the axis.
    size = np.linalg.norm(D, axis=1).max()
    root = np.cbrt(D @ across / size) if degree == 3 else np.sqrt(np.abs(D @ across) / size)
    far = V[np.argmax(root)]
    assert abs(far @ across) < 0.05
    np.testing.assert_allclose(root, np.abs(V @ far) if degree == 2 else V @ far, atol=0.05)


def test_both_ends_move_the_same_way_in_an_arc_and_opposite_ways_in_an_s():
    ball = bending_ball().select([0])
    for degree, sign in ((2, 1.0), (3, -1.0)):
        [D] = bent(ball, degree=degree)
        ends = D[np.linalg.norm(D, axis=1) > 0.9 * np.linalg.norm(D, axis=1).max()]
        cosines = ends @ ends[0] / np.linalg.norm(ends, axis=1) / np.linalg.norm(ends[0])
        assert cosines.min() == pytest.approx(sign)


def test_frames_bend_alike_unless_asked_not_to():
    ball = bending_ball().select([0])[0]
    twice = MeshAnimation.from_arrays(np.array([ball.points, ball.points + 40.0]), ball.faces)
    for per, alike in (("animation", True), ("frame", False)):
        one, two = bent(twice, per=per)
        assert np.allclose(one, two, atol=1e-9) is alike


def test_a_mesh_without_extent_along_the_axis_stays():
    point = MeshAnimation.from_arrays(np.ones((3, 3)), np.array([[0, 1, 2]]))
    assert not np.any(bent(point))
