from __future__ import annotations

import numpy as np
import pytest

from meshmark.errors import UsageError
from meshmark.testing.attacks import AttackSuite, assert_same_frames, bending_ball
from meshmark_plugins.attacks import RECORDS

BY_NAME = {record.name: record for record in RECORDS}


class TestCombination(AttackSuite):
    @pytest.fixture
    def record(self):
        return BY_NAME["combination"]


def test_steps_are_applied_in_order():
    ball = bending_ball()
    text = "scale:factors=1;2;1+noise:amplitude=0.01,kind=gaussian + reverse"
    found = BY_NAME["combination"].factory(attacks=text).apply(ball, np.random.default_rng(3))
    rng = np.random.default_rng(3)
    step = BY_NAME["scale"].factory(factors=(1, 2, 1)).apply(ball, rng)
    step = BY_NAME["noise"].factory(amplitude=0.01, kind="gaussian").apply(step, rng)
    step = BY_NAME["reverse"].factory().apply(step, rng)
    assert_same_frames(list(found), list(step))


def test_attacks_may_be_given_ready_made():
    ball = bending_ball()
    ready = [BY_NAME["reverse"].factory(), BY_NAME["quantization"].factory(bits=5)]
    one = BY_NAME["combination"].factory(attacks=ready)
    two = BY_NAME["combination"].factory(attacks="reverse+quantization:bits=5")
    assert_same_frames(
        *(list(attack.apply(ball, np.random.default_rng(0))) for attack in (one, two))
    )


@pytest.mark.parametrize(
    ("attacks", "words"),
    [
        ("noise+earthquake", "'earthquake'"),
        ("noise:amplitude=-1", "amplitude is -1, but must be"),
        ("noise:size=1", "no parameter 'size'"),
    ],
)
def test_what_a_step_does_not_know_is_said(attacks, words):
    attack = BY_NAME["combination"].factory(attacks=attacks)
    with pytest.raises(UsageError, match=words):
        attack.apply(bending_ball(), np.random.default_rng(0))
