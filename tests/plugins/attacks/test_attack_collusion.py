from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshmark.errors import UsageError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.testing.attacks import AttackSuite, bending_ball, sphere
from meshmark_plugins.attacks import RECORDS
from meshmark_plugins.readers.obj_write import write_new

RECORD = {record.name: record for record in RECORDS}["collusion"]


class Lifted:
    """Lifts every frame by the same amount."""

    def __call__(self, frame: Frame) -> Frame:
        return frame.moved(frame.points + np.array([0.0, 1.0, 0.0]))


class Scaled:
    """Scales every frame about the middle of the ball."""

    def __init__(self, factor):
        self.factor = factor

    def __call__(self, frame: Frame) -> Frame:
        return frame.moved(3.0 + self.factor * (frame.points - 3.0))


def shells(*radii):
    return [bending_ball().map(Scaled(radius)) for radius in radii]


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


class TestCollusionOfSeveral(TestCollusion):
    @pytest.fixture(params=["mean", "median", "min", "max", "extremes", "choice", "alternate"])
    def parameters(self, request):
        return {"other": shells(1.1, 0.9, 1.2), "kind": request.param}

    def test_single_frame_is_treated_or_refused(self, attack, animation):
        with pytest.raises(UsageError, match="other copy 1 has 5 frames, not 1"):
            attack.apply(animation.select([0]), np.random.default_rng(0))


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


def radii(animation):
    """Measure how far the first frame's points are from its middle, a sphere's."""
    return np.linalg.norm(animation[0].points - 3.0, axis=1)


COPIES = (0.9, 1.1, 0.95, 1.25)


@pytest.mark.parametrize(
    ("kind", "radius"),
    [("mean", 1.04), ("median", 1.0), ("min", 0.9), ("max", 1.25)],
)
def test_shells_meet_where_they_must(kind, radius):
    # The copy itself is the unit sphere, and one of five.
    found = collude(bending_ball(), other=shells(*COPIES), kind=kind)
    np.testing.assert_allclose(radii(found), radius, rtol=1e-12)


def test_extremes_are_the_lowest_and_the_highest_half_and_half():
    found = radii(collude(bending_ball(), other=shells(*COPIES), kind="extremes"))
    low, high = np.isclose(found, 0.9), np.isclose(found, 1.25)
    assert np.all(low | high)
    assert np.mean(high) == pytest.approx(0.5, abs=0.1)


def test_every_vertex_comes_from_any_copy():
    found = radii(collude(bending_ball(), other=shells(*COPIES), kind="choice"))
    shares = [np.mean(np.isclose(found, radius)) for radius in (1.0, *COPIES)]
    assert shares == pytest.approx([0.2] * 5, abs=0.06)


@pytest.mark.parametrize("n", [2, 3, 5, 10, 20])
@pytest.mark.parametrize(("kind", "blend"), [("mean", np.mean), ("median", np.median)])
def test_coordinates_are_blended_as_numpy_does(kind, blend, n):
    rng = np.random.default_rng(3)
    ball = bending_ball(3)
    P = np.array([[f.points + 0.01 * rng.normal(size=(600, 3)) for f in ball] for _ in range(n)])
    first, *others = (MeshAnimation.from_arrays(points, ball[0].faces) for points in P)
    found = [frame.points for frame in collude(first, other=others, kind=kind)]
    np.testing.assert_allclose(found, blend(P, axis=0), rtol=1e-14)


@pytest.mark.parametrize("kind", ["choice", "extremes"])
def test_a_vertex_follows_its_copy_through_all_frames(kind):
    ball = bending_ball()
    found = collude(ball, other=shells(1.5), kind=kind)
    up = [
        np.linalg.norm(f.points - b.points, axis=1) > 1e-9 for b, f in zip(ball, found, strict=True)
    ]
    assert 0.3 < np.mean(up[0]) < 0.7
    # Where a later frame's surface faces its middle, the copy that was lower is the higher one.
    least = 1.0 if kind == "choice" else 0.95
    assert min(np.mean(each == up[0]) for each in up) >= least
    attack = RECORD.factory(other=shells(1.5), kind=kind)
    other = attack.apply(ball, np.random.default_rng(1))
    assert not np.array_equal(found[0].points, other[0].points)


@pytest.mark.parametrize("kind", ["min", "extremes", "choice"])
def test_seams_stay_closed(kind):
    V, F = sphere(300)
    corners = F.ravel()
    apart = MeshAnimation.from_arrays(V[corners], np.arange(F.size).reshape(-1, 3))
    others = [
        MeshAnimation.from_arrays((V * (1 + h[:, None]))[corners], apart[0].faces)
        for h in np.random.default_rng(0).normal(scale=0.01, size=(4, len(V)))
    ]
    P = collude(apart, other=others, kind=kind)[0].points
    assert len(np.unique(P, axis=0)) == len(V)


def test_several_copies_alternate_in_turn():
    ball = bending_ball()
    twice = ball.map(Lifted()).map(Lifted())
    found = collude(ball, other=[ball.map(Lifted()), twice], kind="alternate")
    assert lifts(found) == pytest.approx([0, 1, 2, 0, 1])


class CountedFrames:
    """Frames of a source, counted as they are read."""

    def __init__(self, base):
        self.base, self.read = base, []

    def frame(self, index: int) -> Frame:
        self.read.append(index)
        return self.base.frame(index)


def test_frames_are_read_when_they_are_asked_for():
    copies = [replace(ball, source=CountedFrames(ball.source)) for ball in shells(1, 2, 3, 4)]
    found = collude(copies[0], other=copies[1:], kind="max")
    for copy in copies:
        copy.source.read.clear()
    found[3]
    found[1]
    assert [copy.source.read for copy in copies] == [[3, 1]] * 4


@pytest.mark.parametrize("separator", [",", ";", " , "])
def test_several_files_may_be_given_as_text(tmp_path, separator):
    lifted = bending_ball().map(Lifted())
    for name, copy in (("one", lifted), ("two", lifted.map(Lifted()))):
        write_new(Asset("ball", (copy,), "none"), tmp_path / name)
    text = f"{tmp_path / 'one'}{separator}{tmp_path / 'two'}"
    assert lifts(collude(bending_ball(), other=text)) == pytest.approx([1.0] * 5, abs=1e-5)
    paths = [tmp_path / "one", str(tmp_path / "two")]
    assert lifts(collude(bending_ball(), other=paths)) == pytest.approx([1.0] * 5, abs=1e-5)


def test_the_other_copy_may_be_a_file(tmp_path):
    lifted = bending_ball().map(Lifted())
    write_new(Asset("ball", (lifted,), "none"), tmp_path / "copy")
    found = collude(bending_ball(), other=str(tmp_path / "copy"))
    assert lifts(found) == pytest.approx([0.5] * 5, abs=1e-5)


def test_copies_must_be_alike():
    ball = bending_ball()
    with pytest.raises(UsageError, match="other, a second copy, must be given"):
        collude(ball)
    for nothing in ("", " ; ", []):
        with pytest.raises(UsageError, match="other, a second copy, must be given"):
            collude(ball, other=nothing)
    shuffled = {record.name: record for record in RECORDS}["reorder"].factory()
    other = shuffled.apply(ball, np.random.default_rng(0))
    found = collude(ball, other=other)
    assert not found.constant_topology
    with pytest.raises(UsageError, match="frame 1: attack collusion: the copies have different"):
        found[0]
