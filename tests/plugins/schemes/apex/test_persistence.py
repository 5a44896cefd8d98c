"""Local maxima and how far each stands out: by hand, and against a plain union-find."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshmark.mesh.topology import edges
from meshmark.testing.invariance import reordered
from meshmark.testing.meshes import icosphere, plane, torus
from meshmark_plugins.schemes.apex.anchors.persistence import persistent_maxima

MESHES = [plane(5), icosphere(0), icosphere(1), torus(7, 5), plane(9)]
ANY_MESH = pytest.mark.parametrize("F", [F for _, F in MESHES], ids=lambda F: f"{len(F)} faces")


def ridge(*heights):
    """A path of vertices, each joined to the next and, by a triangle, to a vertex at 0."""
    n = len(heights)
    F = np.stack([np.arange(n - 1), np.arange(1, n), np.full(n - 1, n)], axis=1)
    return np.array([*heights, 0.0]), F


def found(f, F, least=0.0):
    maxima = persistent_maxima(f, F, least)
    return list(zip(maxima.vertices.tolist(), maxima.persistence.tolist(), strict=True))


def by_union_find(f, F):
    """Flood from the top, vertex after vertex: what merges into something higher dies."""
    neighbours = [[] for _ in f]
    for a, b in edges(F).tolist():
        neighbours[a].append(b)
        neighbours[b].append(a)
    order = sorted(range(len(f)), key=lambda v: (-f[v], v))
    rank = {v: r for r, v in enumerate(order)}
    component: dict[int, int] = {}
    died = {}
    for v in order:
        peaks = sorted({component[w] for w in neighbours[v] if w in component}, key=rank.get)
        for younger in peaks[1:]:
            died[younger] = f[younger] - f[v]
        component[v] = peaks[0] if peaks else v
        component = {w: peaks[0] if p in peaks else p for w, p in component.items()}
    died[order[0]] = f[order[0]] - f[order[-1]]
    return sorted(died.items(), key=lambda item: (-item[1], rank[item[0]]))


def test_each_summit_of_a_ridge_stands_out_over_its_higher_pass():
    f, F = ridge(1, 5, 2, 7, 4, 6, 3, 3.5)
    assert found(f, F) == [(3, 7.0), (1, 3.0), (5, 2.0), (7, 0.5)]


def test_a_summit_dies_where_its_whole_flank_meets_a_higher_one():
    # 5 drowns in 6 at 4; it is 6, on the far side, that meets 7 at the pass beside 5.
    f, F = ridge(7, 2, 5, 4, 6)
    assert found(f, F) == [(0, 7.0), (4, 4.0), (2, 1.0)]
    # The other way round: 6 takes over 5, and dies where 5's flank ends.
    f, F = ridge(6, 4, 5, 1, 7)
    assert found(f, F) == [(4, 7.0), (0, 5.0), (2, 1.0)]


def test_of_equal_summits_the_first_is_the_elder():
    f, F = ridge(5, 2, 5, 3, 5)
    assert found(f, F) == [(0, 5.0), (2, 3.0), (4, 2.0)]


def test_only_what_stands_out_enough_is_reported():
    f, F = ridge(1, 5, 2, 7, 4, 6, 3, 3.5)
    assert found(f, F, 2.0) == [(3, 7.0), (1, 3.0), (5, 2.0)]
    assert found(f, F, np.nextafter(2.0, 3.0)) == [(3, 7.0), (1, 3.0)]
    assert found(f, F, 7.5) == []


def test_a_plateau_has_one_maximum_that_stands_out():
    V, F = plane(6)
    inside = np.all((V[:, :2] > 0.1) & (V[:, :2] < 0.9), axis=1)
    assert found(inside.astype(float), F, 0.5) == [(int(np.argmax(inside)), 1.0)]


@ANY_MESH
@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1))
def test_agrees_with_a_flood_from_the_top(F, seed):
    f = np.random.default_rng(seed).normal(size=F.max() + 1)
    assert found(f, F) == by_union_find(f, F)


@ANY_MESH
@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), levels=st.integers(1, 6))
def test_agrees_where_many_heights_are_equal(F, seed, levels):
    f = np.random.default_rng(seed).integers(0, levels, size=F.max() + 1).astype(float)
    assert found(f, F) == by_union_find(f, F)


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_highest_stands_out_by_the_whole_range_and_the_others_by_less(seed):
    _, F = torus(9, 7)
    f = np.random.default_rng(seed).normal(size=63)
    maxima = persistent_maxima(f, F, 0.0)
    assert maxima.vertices[0] == np.argmax(f)
    assert maxima.persistence[0] == np.ptp(f)
    assert np.all(maxima.persistence[1:] < np.ptp(f))
    assert np.all(np.diff(maxima.persistence) <= 0)


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_order_of_vertices_and_faces_does_not_matter(seed):
    rng = np.random.default_rng(seed)
    V, F = icosphere(1)
    f = rng.normal(size=len(V))
    mixed = reordered(V, F, rng)
    again = persistent_maxima(f[mixed.vertex], mixed.F, 0.0)
    maxima = persistent_maxima(f, F, 0.0)
    np.testing.assert_array_equal(mixed.vertex[again.vertices], maxima.vertices)
    np.testing.assert_array_equal(again.persistence, maxima.persistence)
