from __future__ import annotations

import numpy as np
import pytest

from meshmark.errors import UsageError
from meshmark.mesh.animation import Frame
from meshmark.mesh.asset import Asset
from meshmark.testing.attacks import AttackSuite, bending_ball
from meshmark_plugins.attacks import RECORDS
from meshmark_plugins.readers.obj_write import write_new

RECORD = {record.name: record for record in RECORDS}["collusion"]


class Lifted:
    """Lifts every frame by the same amount."""

    def __call__(self, frame: Frame) -> Frame:
        return frame.moved(frame.points + np.array([0.0, 1.0, 0.0]))


class TestCollusion(AttackSuite):
    @pytest.fixture
    def record(self):
        return RECORD

    @pytest.fixture
    def parameters(self):
        return {"other": bending_ball().map(Lifted())}

    def test_single_frame_is_treated_or_refused(self, attack, animation):
        with pytest.raises(UsageError, match="the other copy has 5 frames, not 1"):
            attack.apply(animation.select([0]), np.random.default_rng(0))


class TestAlternatingCollusion(TestCollusion):
    @pytest.fixture
    def parameters(self):
        return {"other": bending_ball().map(Lifted()), "kind": "alternate"}


def collude(animation, **parameters):
    return RECORD.factory(**parameters).apply(animation, np.random.default_rng(0))


def lifts(found):
    ball = bending_ball()
    return [
        float(np.mean(b.points[:, 1] - a.points[:, 1])) for a, b in zip(ball, found, strict=True)
    ]


def test_the_mean_lies_half_way():
    ball = bending_ball()
    assert lifts(collude(ball, other=ball.map(Lifted()))) == pytest.approx([0.5] * 5)


def test_alternating_frames_come_whole_from_either_copy():
    ball = bending_ball()
    found = collude(ball, other=ball.map(Lifted()), kind="alternate")
    assert lifts(found) == pytest.approx([0, 1, 0, 1, 0])


def test_the_other_copy_may_be_a_file(tmp_path):
    lifted = bending_ball().map(Lifted())
    write_new(Asset("ball", (lifted,), "none"), tmp_path / "copy")
    found = collude(bending_ball(), other=str(tmp_path / "copy"))
    assert lifts(found) == pytest.approx([0.5] * 5, abs=1e-5)


def test_copies_must_be_alike():
    ball = bending_ball()
    with pytest.raises(UsageError, match="other, a second copy, must be given"):
        collude(ball)
    shuffled = {record.name: record for record in RECORDS}["reorder"].factory()
    other = shuffled.apply(ball, np.random.default_rng(0))
    found = collude(ball, other=other)
    assert not found.constant_topology
    with pytest.raises(UsageError, match="frame 1: attack collusion: the copies have different"):
        found[0]
