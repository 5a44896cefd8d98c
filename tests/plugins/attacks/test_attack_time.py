from __future__ import annotations

import numpy as np
import pytest

from meshmark.commands.attack import attack_asset
from meshmark.errors import UsageError
from meshmark.extension.registry import make_attack
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.testing.attacks import AttackSuite, bending_ball, sphere
from meshmark_plugins.attacks import RECORDS

BY_NAME = {record.name: record for record in RECORDS}


class TestResample(AttackSuite):
    @pytest.fixture
    def record(self):
        return BY_NAME["resample"]


class TestDrop(AttackSuite):
    @pytest.fixture
    def record(self):
        return BY_NAME["drop"]


class TestWindow(AttackSuite):
    @pytest.fixture
    def record(self):
        return BY_NAME["window"]


class TestSpeed(AttackSuite):
    @pytest.fixture
    def record(self):
        return BY_NAME["speed"]


class TestSpeedOfTimeCodesOnly(TestSpeed):
    @pytest.fixture
    def parameters(self):
        return {"bake": False, "factor": 2}


class TestReverse(AttackSuite):
    @pytest.fixture
    def record(self):
        return BY_NAME["reverse"]


class TestJunk(AttackSuite):
    @pytest.fixture
    def record(self):
        return BY_NAME["junk"]


class TestJunkAnywhere(TestJunk):
    @pytest.fixture
    def parameters(self):
        return {"where": "random", "share": 0.6}


def moving(path, times=None):
    """Animate a ball whose points all follow a path, a function of time, along x."""
    V, F = sphere(40)
    V = V - V.mean(axis=0)
    times = np.arange(1.0, 18.0) if times is None else np.asarray(times, dtype=float)
    points = V + np.stack([path(times), 0 * times, 0 * times], axis=1)[:, None, :]
    return MeshAnimation.from_arrays(points, F, times=times)


def attacked(name, animation, seed=0, **parameters):
    return BY_NAME[name].factory(**parameters).apply(animation, np.random.default_rng(seed))


def positions(animation):
    return np.array([frame.points[:, 0].mean() for frame in animation])


@pytest.mark.parametrize("factor", [2, 4, 8])
def test_a_linear_motion_survives_resampling(factor):
    line = moving(lambda t: 3 * t)
    np.testing.assert_allclose(positions(attacked("resample", line, factor=factor)), 3 * line.times)


@pytest.mark.parametrize("factor", [2, 4, 8])
def test_a_parabola_becomes_its_chords(factor):
    parabola = moving(lambda t: t**2)
    found = attacked("resample", parabola, factor=factor)
    assert found.times.tolist() == parabola.times.tolist()
    # The chord of t^2 over a gap h lies above it by (t - a)(b - t), at most h^2 / 4.
    above = positions(found) - parabola.times**2
    np.testing.assert_allclose(above[::factor], 0, atol=1e-9)
    assert above.max() == pytest.approx(factor**2 / 4)


def test_the_last_frame_is_kept_where_the_factor_does_not_divide():
    parabola = moving(lambda t: t**2, np.arange(1, 12))
    found = positions(attacked("resample", parabola, factor=4))
    np.testing.assert_allclose(found[[0, 4, 8, 10]], [1, 25, 81, 121])
    assert found[9] == pytest.approx((81 + 121) / 2)


def test_resampling_respects_uneven_times():
    parabola = moving(lambda t: t**2, [0, 1, 4, 9, 10])
    found = positions(attacked("resample", parabola, factor=2))
    np.testing.assert_allclose(found, [0, 4, 16, 16 + (5 / 6) * 84, 100], atol=1e-9)


def test_dropping_removes_the_stated_share_and_nothing_else():
    line = moving(lambda t: 3 * t)
    found = attacked("drop", line, share=0.25)
    assert len(found) == 13
    np.testing.assert_allclose(positions(found), 3 * found.times)
    others = {tuple(attacked("drop", line, seed, share=0.25).times) for seed in range(5)}
    assert len(others) == 5
    assert len(attacked("drop", line, share=0.999)) == 1


def test_a_window_is_consecutive():
    line = moving(lambda t: 3 * t)
    for start, first in [(0, 1), (1, 14), (0.5, 7)]:
        found = attacked("window", line, share=0.25, start=start)
        assert found.times.tolist() == list(range(first, first + 4))
        np.testing.assert_allclose(positions(found), 3 * found.times)
    starts = {attacked("window", line, seed, share=0.25).times[0] for seed in range(100)}
    assert starts == set(range(1, 15))


def test_double_speed_shows_every_second_frame():
    parabola = moving(lambda t: t**2)
    found = attacked("speed", parabola, factor=2)
    assert found.times.tolist() == list(range(1, 10))
    np.testing.assert_allclose(positions(found), np.arange(1.0, 18, 2) ** 2)


def test_slower_speed_shows_linear_in_betweens():
    parabola = moving(lambda t: t**2)
    found = attacked("speed", parabola, factor=0.5)
    assert len(found) == 33
    between = np.interp(np.arange(1, 17.1, 0.5), parabola.times, parabola.times**2)
    np.testing.assert_allclose(positions(found), between)


def test_speed_without_baking_moves_time_codes_only():
    parabola = moving(lambda t: t**2)
    found = attacked("speed", parabola, factor=4, bake=False)
    np.testing.assert_allclose(found.times, 1 + np.arange(17) / 4)
    np.testing.assert_allclose(positions(found), parabola.times**2)


def test_one_frame_has_no_speed():
    with pytest.raises(UsageError, match="one frame has no speed"):
        attacked("speed", moving(lambda t: t).select([0]))


def test_reversing_twice_changes_nothing():
    parabola = moving(lambda t: t**2, [0, 1, 4, 9, 10])
    once = attacked("reverse", parabola)
    assert once.times.tolist() == [0, 1, 6, 9, 10]
    np.testing.assert_allclose(positions(once), [100, 81, 16, 1, 0], atol=1e-9)
    twice = attacked("reverse", once)
    assert twice.times.tolist() == parabola.times.tolist()
    np.testing.assert_array_equal(positions(twice), positions(parabola))


@pytest.mark.parametrize(
    "name", ["drop", "resample", "reverse", "scale", "speed", "window", "combination"]
)
def test_a_mesh_that_does_not_change_stays_beside_one_that_moves(name):
    still = MeshAnimation.from_arrays(*sphere(100), times=np.array([np.nan]), prim="/still")
    asset = Asset("x", (bending_ball(), still), "memory")
    attacked = attack_asset(asset, make_attack(name), 0).meshes[1]
    assert len(attacked) == 1
    assert np.isnan(attacked.times[0])


@pytest.mark.parametrize(
    ("share", "n", "scrambled"), [(0.5, 8, 4), (0.01, 8, 1), (0.99, 8, 7), (0.5, 1, 0)]
)
def test_the_first_frames_are_scrambled_and_one_stays(share, n, scrambled):
    ball = moving(np.sqrt).select(range(n))
    after = attacked("junk", ball, share=share)
    same = [np.array_equal(one.points, two.points) for one, two in zip(ball, after, strict=True)]
    assert same == [False] * scrambled + [True] * (n - scrambled)


def test_scrambled_frames_have_the_same_points_each_in_an_order_of_its_own():
    V, F = sphere(40)
    still = MeshAnimation.from_arrays(np.array([V] * 6), F)
    after = [frame.points for frame in attacked("junk", still, share=0.5, where="random")]
    junk = [points for points in after if not np.array_equal(points, V)]
    assert len(junk) == 3
    assert len({points.tobytes() for points in junk}) == 3
    for points in junk:
        np.testing.assert_array_equal(np.unique(points, axis=0), np.unique(V, axis=0))
    assert not np.array_equal(after[:3], junk)
