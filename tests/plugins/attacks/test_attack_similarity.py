from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.topology import Topology
from meshmark.testing.attacks import AttackSuite, bending_ball, sphere
from meshmark_plugins.attacks import RECORDS

BY_NAME = {record.name: record for record in RECORDS}


class TestSimilarity(AttackSuite):
    @pytest.fixture
    def record(self):
        return BY_NAME["similarity"]


class TestSimilarityOfEachFrame(TestSimilarity):
    @pytest.fixture
    def parameters(self):
        return {"per": "frame"}


class TestScale(AttackSuite):
    @pytest.fixture
    def record(self):
        return BY_NAME["scale"]


def attacked(name, animation, seed=0, **parameters):
    return BY_NAME[name].factory(**parameters).apply(animation, np.random.default_rng(seed))


def distances(frame):
    return pdist(frame.points[::10])


def volume(frame):
    a, b, c = (frame.points[frame.faces[:, k]] for k in range(3))
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6


@pytest.mark.parametrize("per", ["frame", "animation"])
def test_ratios_of_distances_and_orientation_are_kept(per):
    ball = bending_ball()
    moved = attacked("similarity", ball, per=per)
    scales = []
    for before, after in zip(ball, moved, strict=True):
        ratio = distances(after) / distances(before)
        np.testing.assert_allclose(ratio, ratio[0], rtol=1e-9)
        np.testing.assert_allclose(volume(after) / volume(before), ratio[0] ** 3, rtol=1e-9)
        scales.append(ratio[0])
    assert bool(np.ptp(scales) < 1e-9) is (per == "animation")


def test_one_transform_for_the_animation_keeps_the_motion_rigidly():
    ball = bending_ball()
    moved = attacked("similarity", ball)
    path = [np.stack([frame.points[j] for frame in moved]) for j in (0, 300)]
    before = [np.stack([frame.points[j] for frame in ball]) for j in (0, 300)]
    lengths = [np.linalg.norm(np.diff(p, axis=0), axis=1) for p in path]
    wanted = [np.linalg.norm(np.diff(p, axis=0), axis=1) for p in before]
    ratio = np.concatenate(lengths) / np.concatenate(wanted)
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-9)


def test_scales_and_moves_fill_their_ranges():
    still = MeshAnimation.from_arrays(*sphere(200))
    frames = [attacked("similarity", still, seed)[0] for seed in range(300)]
    scale = np.array([distances(frame)[0] for frame in frames]) / distances(still[0])[0]
    assert 0.1 <= scale.min() < 0.13
    assert 7.5 < scale.max() <= 10
    # Log-uniform about 1: as many shrink as grow.
    assert np.mean(scale < 1) == pytest.approx(0.5, abs=0.1)
    move = np.array([frame.points.mean(axis=0) for frame in frames])
    assert np.abs(move).max() <= 5.0 + 1e-9
    assert np.all(np.abs(move).max(axis=0) > 4.5)


def test_scale_stretches_the_bounding_box_by_the_factors():
    ball = bending_ball()
    stretched = attacked("scale", ball, factors="1,2,0.5")
    for before, after in zip(ball, stretched, strict=True):
        ratio = np.ptp(after.points, axis=0) / np.ptp(before.points, axis=0)
        np.testing.assert_allclose(ratio, [1, 2, 0.5])


@pytest.mark.parametrize("factors", ["-1,1,1", "-1,-2,-0.5"])
def test_negative_factors_mirror_and_keep_the_outside_outside(factors):
    ball = bending_ball()
    size = np.array([float(factor) for factor in factors.split(",")])
    mirrored = attacked("scale", ball, factors=factors)
    middle = ball[0].points.mean(axis=0)
    for before, after in zip(ball, mirrored, strict=True):
        np.testing.assert_allclose(after.points, middle + size * (before.points - middle))
        assert volume(after) == pytest.approx(np.abs(np.prod(size)) * volume(before))
    assert mirrored.constant_topology
    turned = attacked("scale", ball, factors="-1,-1,1")
    assert turned[0].topology.same_as(ball[0].topology)


def test_a_mirrored_polygon_keeps_its_diagonals():
    shape = Topology(np.array([5, 3, 4]), np.array([0, 1, 2, 3, 4, 4, 3, 5, 1, 6, 7, 2]), 8)
    P = np.random.default_rng(0).normal(size=(8, 3))
    still = MeshAnimation.from_frames([Frame(1.0, P, shape)])
    [after] = attacked("scale", still, factors=(-1, 1, 1))
    assert after.topology.counts.tolist() == [5, 3, 4]
    assert after.topology.indices.tolist() == [0, 4, 3, 2, 1, 4, 5, 3, 1, 2, 7, 6]
    before, turned = (np.sort(F, axis=1).tolist() for F in (shape.triangles, after.faces))
    assert sorted(turned) == sorted(before)


def test_random_factors_stay_within_the_strength():
    still = MeshAnimation.from_arrays(*sphere(200))
    size = np.ptp(still[0].points, axis=0)
    factors = np.array(
        [np.ptp(attacked("scale", still, seed)[0].points, axis=0) / size for seed in range(100)]
    )
    assert 0.9 <= factors.min() < 0.91
    assert 1.09 < factors.max() <= 1.1
    assert np.abs(np.corrcoef(factors.T)[0, 1]) < 0.3
