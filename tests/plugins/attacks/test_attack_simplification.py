from __future__ import annotations

import numpy as np
import pytest

from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.topology import edges
from meshmark.metrics import surface_distance
from meshmark.testing.attacks import AttackSuite, bending_ball, sphere
from meshmark_plugins.attacks import RECORDS
from meshmark_plugins.attacks.carrying import nearest_distinct

BY_NAME = {record.name: record for record in RECORDS}


class TestSimplification(AttackSuite):
    @pytest.fixture
    def record(self):
        return BY_NAME["simplification"]


class TestSimplificationOfEachFrame(TestSimplification):
    @pytest.fixture
    def parameters(self):
        return {"per": "frame", "ratio": 0.5}


class TestFastSimplification(TestSimplification):
    @pytest.fixture
    def parameters(self):
        return {"method": "fast", "per": "frame"}


def simplified(animation, **parameters):
    attack = BY_NAME["simplification"].factory(**parameters)
    return attack.apply(animation, np.random.default_rng(0))


@pytest.mark.parametrize("method", ["quadric", "fast"])
@pytest.mark.parametrize("ratio", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("per", ["frame", "animation"])
def test_the_stated_share_of_edges_goes_and_the_surface_stays(method, ratio, per):
    V, F = sphere(3000)
    still = MeshAnimation.from_arrays(V, F)
    small = simplified(still, method=method, ratio=ratio, per=per)[0]
    gone = 1 - len(edges(small.faces)) / len(edges(F))
    assert gone == pytest.approx(ratio, abs=0.01)
    distance = surface_distance(V, F, small.points, small.faces)
    # A sphere's chords: the sagitta of an edge grows as the square of its length.
    sagitta = (2 / 3000) / (1 - ratio)
    assert distance.mrms < 3 * sagitta


def test_no_ratio_changes_nothing_but_the_order():
    V, F = sphere(500)
    small = simplified(MeshAnimation.from_arrays(V, F), ratio=0.0)[0]
    assert len(small.faces) == len(F)
    assert surface_distance(V, F, small.points, small.faces).hausdorff < 1e-6


def test_one_connectivity_is_a_subset_of_the_vertices_in_every_frame():
    ball = bending_ball()
    small = simplified(ball, ratio=0.4)
    assert small.constant_topology
    j = [int(np.flatnonzero((ball[0].points == p).all(axis=1))[0]) for p in small[0].points]
    assert len(set(j)) == len(j)
    for before, after in zip(ball, small, strict=True):
        np.testing.assert_array_equal(after.points, before.points[j])


def test_each_frame_by_itself_gets_a_connectivity_of_its_own():
    small = simplified(bending_ball(), ratio=0.4, per="frame")
    assert not small.constant_topology
    assert not small[0].topology.same_as(small[4].topology)


def test_nearest_distinct_gives_everyone_a_vertex_of_their_own():
    rng = np.random.default_rng(0)
    V = rng.normal(size=(300, 3))
    # Every point wants the same vertex; the closer ones get closer vertices.
    P = V[0] + 1e-6 * np.arange(1, 201)[:, None] * [1, 0, 0]
    given = nearest_distinct(V, P)
    assert given[0] == 0
    assert len(np.unique(given)) == 200
    distance = np.linalg.norm(V[given] - V[0], axis=1)
    assert np.all(np.diff(distance[:10]) > 0)
    # All vertices can be handed out.
    assert sorted(nearest_distinct(V, rng.normal(size=(300, 3))).tolist()) == list(range(300))
    # Who stands on a vertex of their own keeps it.
    order = rng.permutation(300)[:120]
    np.testing.assert_array_equal(nearest_distinct(V, V[order]), order)
