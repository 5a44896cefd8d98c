from __future__ import annotations

import numpy as np
import pytest

from meshmark.detection.verify import verify
from meshmark.embedding.asset import embed
from meshmark.errors import UsageError
from meshmark.keys import KEY_BYTES, Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.testing.attacks import AttackSuite, bending_ball
from meshmark.testing.meshes import bumpy_sphere, icosphere
from meshmark_plugins.attacks import RECORDS

RECORD = {record.name: record for record in RECORDS}["marking-again"]


def star(level=3):
    """Animate a ball with six horns, which can hold a mark."""
    V, F = bumpy_sphere(level, np.concatenate([np.eye(3), -np.eye(3)]))
    points = np.array([V, V * [1.0, 1.05, 1.0]])
    return MeshAnimation.from_arrays(points, F, prim="/Star", origin="star.usda")


class TestMarkingAgain(AttackSuite):
    @pytest.fixture
    def record(self):
        return RECORD

    @pytest.fixture
    def animation(self):
        return star()


def again(animation, seed=0, copies=1):
    return RECORD.factory(copies=copies).apply(animation, np.random.default_rng(seed))


@pytest.mark.slow
def test_several_copies_are_averaged():
    animation, rng = star(), np.random.default_rng(0)
    keys = [Key(rng.bytes(KEY_BYTES)) for _ in range(2)]
    copies = [embed(animation, key).meshes[0].animation for key in keys]
    mean = np.mean([copy[1].points for copy in copies], axis=0)
    np.testing.assert_allclose(again(animation, copies=2)[1].points, mean, atol=1e-7)


def test_the_key_drawn_is_found_on_what_comes_of_it():
    key = Key(np.random.default_rng(3).bytes(KEY_BYTES))
    beside = verify(again(star(), seed=3), key, original=star())
    assert beside.verdict == "marked"
    # A star of so few points and frames holds little by itself.
    assert verify(again(star(), seed=3), key, frames=":", fpr=1e-3).verdict == "marked"


def test_a_mesh_that_can_hold_no_mark_stays_as_it_is_and_says_so():
    ball = MeshAnimation.from_arrays(*icosphere(1))
    after = again(ball)
    np.testing.assert_array_equal(after[0].points, ball[0].points)
    assert after.notes[-1].startswith("attack marking-again left it as it is: ")


def test_a_varying_connectivity_is_refused():
    ball = bending_ball()
    frames = [ball[0], star()[1]]
    with pytest.raises(UsageError, match="one connectivity"):
        again(MeshAnimation.from_frames(frames))
