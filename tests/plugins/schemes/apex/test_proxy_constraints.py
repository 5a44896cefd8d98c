"""Marking of fine meshes by proxies: what is planned on, how chips follow it, what comes of it."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.closest_points import ClosestPoints
from meshmark.mesh.geometry import area_vectors
from meshmark.metrics.surface_distance import surface_distance
from meshmark.testing.meshes import bumpy_sphere, icosphere, side_by_side
from meshmark_plugins.schemes.apex.anchors import proxies
from meshmark_plugins.schemes.apex.anchors.geodesic_field import geodesic_fields
from meshmark_plugins.schemes.apex.anchors.pose_distances import PoseDistances
from meshmark_plugins.schemes.apex.anchors.proxies import MarkingProxies
from meshmark_plugins.schemes.apex.chips.gradients import (
    distance_directions,
    surface_means,
    vertex_chips,
)
from meshmark_plugins.schemes.apex.marking.marked_anchors import field_chips
from meshmark_plugins.schemes.apex.marking.planning_proxy import planning_proxy
from meshmark_plugins.schemes.apex.marking.pose_constraints import PoseConstraints
from meshmark_plugins.schemes.apex.scheme import Apex

HORNS = np.array([[1, 0.2, 0.1], [-0.3, 1, 0.2], [-0.6, -0.7, 0.5], [0.2, -0.5, -1]])
K, WIDTH = 8, 0.09
WORDS = np.array(Key(bytes(range(32))).words("apex", Apex().n_words, Apex().n_chips))


@pytest.fixture
def fine(monkeypatch):
    """Measure meshes of more than 1,000 vertices on proxies of so many."""

    def most(vertices: int) -> None:
        monkeypatch.setattr(proxies, "MOST_VERTICES", vertices)
        monkeypatch.setattr(proxies, "PROXY_VERTICES", vertices)
        monkeypatch.setattr(proxies, "MARKING_PROXY_VERTICES", vertices)

    most(1_000)
    return most


@pytest.fixture
def horned(fine):
    """A fine surface, its proxy, and the field of two tips on it and on its proxy."""
    V, F = bumpy_sphere(4, HORNS)
    tips = np.array([np.argmax(V @ horn) for horn in HORNS[:2]])
    built = MarkingProxies(V, F)
    planning = planning_proxy(V, F, tips, built)
    (field,) = geodesic_fields(V, F, tips, proxies=built)
    return V, F, planning, field, planning.of_proxy(field)


def test_one_proxy_stands_for_all_components_with_anchors(fine):
    V, F = side_by_side(bumpy_sphere(4, HORNS), bumpy_sphere(3, HORNS), icosphere(3))
    large, small = 2562, 642
    planning = planning_proxy(V, F, np.array([5, large + 7]), MarkingProxies(V, F))
    proxy, (of_large, of_small) = planning.proxy, planning.parts
    n = len(of_large.component.vertices)
    assert 800 < n < 1_200
    assert len(proxy.samples) == n + small
    # What is not fine stands for itself, and moves of the whole are kept.
    shift = np.array([3.0, -1.0, 0.5])
    moved = V + shift
    np.testing.assert_allclose(proxy.fit(moved)[n:], moved[large : large + small], atol=1e-9)
    still = np.broadcast_to(shift, (n + small, 3))
    np.testing.assert_allclose(proxy.fit(moved) - proxy.fit(V), still, atol=1e-9)
    on_mesh = proxy.prolongation @ proxy.fit(V)
    assert np.linalg.norm(on_mesh - V, axis=1)[:large].max() < 0.05
    np.testing.assert_array_equal(on_mesh[large + small :], 0.0)
    np.testing.assert_array_equal(
        proxy.faces, np.concatenate([of_large.component.faces, n + of_small.component.faces])
    )


def test_a_mesh_without_fine_components_needs_none(fine):
    V, F = bumpy_sphere(3, HORNS)
    planning = planning_proxy(V, F, np.array([5]), MarkingProxies(V, F))
    assert planning.proxy is None
    (part,) = planning.parts
    np.testing.assert_array_equal(part.component.faces, F)
    np.testing.assert_array_equal(part.prolongation @ V, V)


def test_chips_of_a_proxy_are_those_of_the_mesh(horned):
    _, _, planning, field, on_proxy = horned
    s, n, weights = field_chips(field, 1.0, K, WIDTH)
    means, counts, _ = vertex_chips(
        on_proxy.H,
        distance_directions(on_proxy),
        planning.parts[0].prolongation,
        weights,
        WIDTH,
        K,
    )
    own = surface_means(on_proxy.V, on_proxy.component.faces, on_proxy.H, WIDTH, K)
    # But for the rounding to cells.
    np.testing.assert_allclose(means - own, s, atol=0.015)
    np.testing.assert_allclose(counts, n, rtol=0.1)


def test_chips_follow_moves_of_the_proxy_as_their_gradients_foretell(horned):
    _, _, planning, _, on_proxy = horned
    P = planning.parts[0].prolongation
    slopes = distance_directions(on_proxy) / on_proxy.length_scale
    weights = np.random.default_rng(0).uniform(0.5, 1.5, P.shape[0])
    # So short that hardly any vertex goes from one bin to the next.
    d = 1e-6 * np.random.default_rng(1).normal(size=on_proxy.V.shape)
    H = on_proxy.H
    before, after = (
        vertex_chips(H + step * np.einsum("mnx,nx->mn", slopes, d), slopes, P, weights, WIDTH, K)
        for step in (-1.0, 1.0)
    )
    foretold = vertex_chips(H, slopes, P, weights, WIDTH, K)[2] @ d.ravel()
    change = 0.5 * (after[0] - before[0]).ravel()
    np.testing.assert_allclose(change, foretold, atol=0.02 * np.abs(foretold).max())


@pytest.mark.slow
def test_a_mesh_marked_by_a_proxy_reads_as_one_marked_without(fine):
    V, F = bumpy_sphere(5, HORNS)
    scheme, animation = Apex(), MeshAnimation.from_arrays(V, F)
    clear = []
    for vertices in (len(V), 5_000):
        fine(vertices)
        plan = scheme.plan(animation, WORDS)
        assert (plan.transfer.proxy is None) == (vertices == len(V))
        X = plan.mark(0, animation[0])
        far = surface_distance(V, F, X, F, seed=1)
        assert far.mrms / far.diagonal < scheme.parameters.max_mrms
        assert np.vecdot(area_vectors(V, F), area_vectors(X, F)).min() > 0.0
        fine(len(V))
        seen = scheme.observe(animation[0].moved(X))
        clear.append((seen.soft @ WORDS.T).max(axis=2)[:, :4].mean(axis=1).max())
    assert clear[1] > 0.9 * clear[0]
    assert clear[0] > 8.0


def test_what_one_pose_would_hold_back_is_held_back_in_all_of_a_fine_mesh(fine):
    V = np.stack([bumpy_sphere(4, HORNS, h)[0] for h in (1.5, 1.3)])
    animation = MeshAnimation.from_arrays(V, bumpy_sphere(4, HORNS)[1])
    plan = Apex(width=0.08).plan(animation, WORDS)
    d, left = plan.displacement(0), plan.share(0)
    assert d.shape == (3 * len(plan.transfer.proxy.samples),)
    assert d.any()
    assert left.shape == (len(V[0]),)
    for P in V:
        surface = ClosestPoints(P, animation[0].faces)
        _, share, _ = plan.transfer.apply(P, d, surface, left)
        assert np.mean(share < 1.0) < 0.01


def test_what_detection_measured_is_not_measured_again(fine, monkeypatch):
    """By a proxy or without, in a pose that recurs elsewhere, too."""
    V, F = bumpy_sphere(4, HORNS)
    animation = MeshAnimation.from_arrays(np.stack([V, 1.02 * V, V + 5.0]), F)
    again, measure = [], PoseConstraints._measured
    monkeypatch.setattr(
        PoseConstraints, "_measured", lambda self, t: again.append(t) or measure(self, t)
    )
    for vertices in (len(V), 1_000):
        fine(vertices)
        with monkeypatch.context() as forgetful:
            forgetful.setattr(PoseDistances, "of", lambda *_: [])
            wanted = Apex().plan(animation, WORDS).displacement(0)
        assert sorted(again) == [0, 1, 2]
        again.clear()
        found = Apex().plan(animation, WORDS).displacement(0)
        assert not again
        np.testing.assert_allclose(found, wanted, atol=1e-3 * np.abs(wanted).max())
