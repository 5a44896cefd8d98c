"""What every attack must do; subclass `AttackSuite` in your own tests to check yours.

class TestMyAttack(AttackSuite):
    @pytest.fixture
    def record(self):
        return my_plugin.RECORD
"""

from __future__ import annotations

import contextlib
import pickle
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import InputError, UsageError
from meshmark.extension.hookspecs import Attack, AttackRecord
from meshmark.mesh.animation import Frame, MeshAnimation


def bending_ball(n_frames: int = 5) -> MeshAnimation:
    """Animate a closed sphere of 600 points that bends and drifts, nowhere symmetric in time."""
    V, F = sphere(600)
    t = np.linspace(0.0, 1.0, n_frames)[:, None]
    x, y, z = V.T
    points = np.stack([x + 0.4 * t * y**2, y * (1.0 + 0.3 * t**2), z + 0.2 * t * x], axis=2)
    return MeshAnimation.from_arrays(points + 3.0, F, prim="/Ball", origin="ball.usda")


def sphere(n: int) -> tuple[FloatArray, IntArray]:
    """Spread n points evenly over the unit sphere, triangulated by their hull, outward."""
    z = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(n)
    r = np.sqrt(1.0 - z**2)
    V = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)
    F = ConvexHull(V).simplices.astype(np.int64)
    a, b, c = V[F[:, 0]], V[F[:, 1]], V[F[:, 2]]
    outward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a)
    F[outward < 0] = F[outward < 0][:, ::-1]
    return V, F


class AttackSuite:
    """Checks the contract of one attack; override `record`, and what else differs."""

    @pytest.fixture
    def record(self) -> AttackRecord:
        """Offer the attack under test."""
        raise NotImplementedError("override the fixture `record`")

    @pytest.fixture
    def parameters(self) -> dict[str, Any]:
        """Offer the parameters to test it with, where the defaults will not do."""
        return {}

    @pytest.fixture
    def animation(self) -> MeshAnimation:
        """Offer the animation to attack."""
        return bending_ball()

    @pytest.fixture
    def attack(self, record: AttackRecord, parameters: dict[str, Any]) -> Attack:
        """Build the attack."""
        return record.factory(**parameters)

    def test_record_is_complete(self, record: AttackRecord) -> None:
        """A record names its attack, says in one line what it does, and has a version."""
        assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", record.name)
        assert record.summary.strip()
        assert "\n" not in record.summary
        assert record.version

    def test_builds_an_attack(self, attack: Attack) -> None:
        """The factory makes something with `apply`."""
        assert isinstance(attack, Attack)

    def test_recorded_parameters_are_the_defaults(
        self, record: AttackRecord, parameters: dict[str, Any]
    ) -> None:
        """Giving the recorded defaults changes nothing."""
        everything = {**record.parameters, **parameters}
        assert record.factory(**everything) == record.factory(**parameters)

    def test_refuses_an_unknown_parameter(self, record: AttackRecord) -> None:
        """A parameter the attack does not have is refused by name."""
        with pytest.raises(UsageError, match="no_such_parameter"):
            record.factory(no_such_parameter=1)

    def test_leaves_the_given_animation_alone(
        self, attack: Attack, animation: MeshAnimation
    ) -> None:
        """Attacking never writes into the frames it was given."""
        before = [frame.points.copy() for frame in animation]
        list(attack.apply(animation, np.random.default_rng(1)))
        for points, frame in zip(before, animation, strict=True):
            np.testing.assert_array_equal(frame.points, points)

    def test_result_is_a_sound_animation(self, attack: Attack, animation: MeshAnimation) -> None:
        """The result keeps prim and origin, and every frame is finite and consistent."""
        result = attack.apply(animation, np.random.default_rng(1))
        assert (result.prim, result.origin) == (animation.prim, animation.origin)
        assert np.all(np.isfinite(result.times))
        frames = list(result)
        assert len(frames) == len(result) >= 1
        for time, frame in zip(result.times, frames, strict=True):
            assert frame.time == time
            assert frame.points.dtype == np.float64
            assert frame.points.shape == (frame.topology.n_points, 3)
            assert np.all(np.isfinite(frame.points))
        if result.constant_topology:
            assert all(frames[0].topology.same_as(frame.topology) for frame in frames)

    def test_same_seed_same_result(self, attack: Attack, animation: MeshAnimation) -> None:
        """All randomness comes from the generator."""
        one = attack.apply(animation, np.random.default_rng(7))
        two = attack.apply(animation, np.random.default_rng(7))
        assert_same_frames(list(one), list(two))

    def test_frames_do_not_depend_on_the_order_they_are_read_in(
        self, attack: Attack, animation: MeshAnimation
    ) -> None:
        """Lazy frames are a function of their index."""
        result = attack.apply(animation, np.random.default_rng(7))
        forwards = list(result)
        backwards = [result[index] for index in reversed(range(len(result)))]
        assert_same_frames(forwards, backwards[::-1])

    def test_result_pickles(self, attack: Attack, animation: MeshAnimation) -> None:
        """Worker processes see the same frames."""
        result = attack.apply(animation, np.random.default_rng(7))
        assert_same_frames(list(result), list(pickle.loads(pickle.dumps(result))))

    def test_single_frame_is_treated_or_refused(
        self, attack: Attack, animation: MeshAnimation
    ) -> None:
        """A mesh without time samples is treated, or refused with a reason."""
        still = MeshAnimation.from_frames(
            [Frame(float("nan"), animation[0].points, animation[0].topology)]
        )
        with contextlib.suppress(UsageError, InputError):
            result = attack.apply(still, np.random.default_rng(7))
            assert all(np.all(np.isfinite(frame.points)) for frame in result)


def assert_same_frames(one: Sequence[Frame], two: Sequence[Frame]) -> None:
    """Fail unless both hold the same times, points and polygons, bit for bit."""
    assert len(one) == len(two)
    for a, b in zip(one, two, strict=True):
        assert a.time == b.time
        np.testing.assert_array_equal(a.points, b.points)
        assert a.topology.same_as(b.topology)
