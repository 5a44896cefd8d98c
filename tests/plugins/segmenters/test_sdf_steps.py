"""The steps of the SDF segmenter, each by itself."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshmark.mesh.topology import face_components
from meshmark.testing.meshes import icosphere, plane, side_by_side
from meshmark.testing.segmenters import lopsided
from meshmark_plugins.segmenters.sdf import SDFSegmenter
from meshmark_plugins.segmenters.sdf.creases import cut_costs
from meshmark_plugins.segmenters.sdf.cut import expand
from meshmark_plugins.segmenters.sdf.dual import DualGraph
from meshmark_plugins.segmenters.sdf.mixture import Mixture
from meshmark_plugins.segmenters.sdf.parts import parts_of
from meshmark_plugins.segmenters.sdf.smoothing import diffuse

# Smoothing


def test_diffusion_keeps_constants_and_the_mean():
    V, F = lopsided()
    dual = DualGraph.of(V, F)
    x = np.random.default_rng(0).normal(size=(len(F), 1))
    smooth = diffuse(np.hstack([x, np.ones_like(x)]), dual, 1e-3)
    np.testing.assert_allclose(smooth[:, 1], 1.0, rtol=1e-9)
    big = dual.area > 0.01 * np.median(dual.area)
    assert big.all()
    assert dual.area @ smooth[:, 0] == pytest.approx(dual.area @ x[:, 0], abs=1e-9)
    assert np.std(smooth[:, 0]) < 0.3


def test_diffusion_damps_a_wave_at_the_rate_of_the_heat_equation():
    # On the unit sphere L z = 2 z; one implicit step divides by 1 + 2 t, t in units of the area.
    V, F = icosphere(4)
    dual = DualGraph.of(V, F)
    z = dual.centroid[:, 2:]
    time = 0.02
    damped = diffuse(z, dual, time)
    rate = (dual.area @ (damped * z)) / (dual.area @ z**2)
    assert rate[0] == pytest.approx(1.0 / (1.0 + 2.0 * time * 4.0 * np.pi), rel=0.02)


def test_diffusion_beyond_the_range_of_numbers_is_a_breakdown() -> None:
    V, F = icosphere(1)
    dual = DualGraph.of(V, F)
    with np.errstate(all="ignore"), pytest.raises(np.linalg.LinAlgError, match="not finite"):
        diffuse(np.full((len(F), 1), np.inf), dual, 1e-3)


# Mixture


def test_mixture_finds_the_gaussians_it_was_made_of():
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.normal(0.3, 0.05, 6000), rng.normal(0.7, 0.1, 2000)])
    fitted = Mixture.fit(np.clip(x, 0, 1), np.ones(8000), 2, tied=False)
    np.testing.assert_allclose(fitted.mu, [0.3, 0.7], atol=0.02)
    np.testing.assert_allclose(fitted.sigma, [0.05, 0.1], atol=0.02)
    np.testing.assert_allclose(fitted.weight, [0.75, 0.25], atol=0.03)


def test_mixture_counts_weight_as_it_counts_copies():
    rng = np.random.default_rng(1)
    x, copies = rng.random(500), rng.integers(1, 9, 500)
    weighted = Mixture.fit(x, copies.astype(float), 3, tied=True)
    repeated = Mixture.fit(np.repeat(x, copies), np.ones(copies.sum()), 3, tied=True)
    np.testing.assert_allclose(weighted.mu, repeated.mu, rtol=1e-6)
    assert np.ptp(weighted.sigma) == 0.0


def test_mixture_finds_a_small_cluster_beside_a_large_one():
    x = np.concatenate([np.full(950, 0.9), np.full(50, 0.3)])
    fitted = Mixture.fit(x, np.ones(1000), 2, tied=True)
    np.testing.assert_allclose(fitted.mu, [0.3, 0.9], atol=2e-3)


def test_posterior_beyond_the_outermost_means_stays_with_them():
    narrow = Mixture(np.array([0.5, 0.5]), np.array([0.3, 0.8]), np.array([0.2, 0.02]))
    posterior = narrow.log_posterior(np.array([0.0, 0.3, 0.8, 1.0]))
    np.testing.assert_array_equal(posterior.argmax(axis=1), [0, 0, 1, 1])
    np.testing.assert_allclose(np.exp(posterior).sum(axis=1), 1.0)


# Cuts


def energies(cost, pairs, weight):
    """Every labelling of a small graph, and its energy."""
    n, k = cost.shape
    for labels in itertools.product(range(k), repeat=n):
        x = np.array(labels)
        differ = x[pairs[:, 0]] != x[pairs[:, 1]]
        yield cost[np.arange(n), x].sum() + weight[differ].sum(), x


def energy(labels, cost, pairs, weight):
    differ = labels[pairs[:, 0]] != labels[pairs[:, 1]]
    return cost[np.arange(len(labels)), labels].sum() + weight[differ].sum()


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1))
def test_cut_in_two_is_the_best_of_all(seed):
    rng = np.random.default_rng(seed)
    cost, weight = rng.random((9, 2)), 0.5 * rng.random(16)
    pairs = np.array([rng.choice(9, 2, replace=False) for _ in range(16)])
    best = min(value for value, _ in energies(cost, pairs, weight))
    assert energy(expand(cost, pairs, weight), cost, pairs, weight) == pytest.approx(best)


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_cut_in_three_is_within_the_bound_and_no_expansion_helps(seed):
    rng = np.random.default_rng(seed)
    cost, weight = rng.random((6, 3)), 0.5 * rng.random(9)
    pairs = np.array([rng.choice(6, 2, replace=False) for _ in range(9)])
    labels = expand(cost, pairs, weight)
    found = energy(labels, cost, pairs, weight)
    by_energy = list(energies(cost, pairs, weight))
    assert found <= 2.0 * min(value for value, _ in by_energy) + 1e-9
    for value, x in by_energy:
        changed = np.unique(x[x != labels])
        if len(changed) == 1:
            assert found <= value + 1e-7


def test_cut_without_neighbours_takes_the_cheapest_label():
    cost = np.random.default_rng(0).random((50, 4))
    none = np.zeros((0, 2), dtype=np.int64)
    np.testing.assert_array_equal(expand(cost, none, np.zeros(0)), cost.argmin(axis=1))


def test_creases_are_cheaper_than_ridges():
    # Two planes that meet along y = 0 at a right angle, seen as a valley and as a ridge.
    V, F = plane(9)
    price = {}
    for name, sign in (("valley", 1.0), ("ridge", -1.0)):
        bent = V - [0.5, 0.5, 0.0]
        bent[:, 2] = sign * np.abs(bent[:, 1])
        dual = DualGraph.of(bent, F)
        cost = cut_costs(dual.normal, dual, 0.02) / dual.length
        i, j = dual.pairs.T
        across = np.abs(np.einsum("ij,ij->i", dual.normal[i], dual.normal[j])) < 0.5
        assert across.sum() == 8
        price[name] = cost[across]
        np.testing.assert_allclose(cost[~across], 1.0)
    np.testing.assert_allclose(price["ridge"], 1.0)
    assert np.all(price["valley"] < 0.9)


# Parts


def test_small_regions_join_the_neighbour_they_border_most():
    V, F = plane(11)
    dual = DualGraph.of(V, F)
    x, y = V[F].mean(axis=1)[:, :2].T
    labels = (x > 0.5).astype(np.int64)
    labels[(np.abs(x - 0.25) < 0.06) & (np.abs(y - 0.25) < 0.06)] = 2
    parts = parts_of(labels, F, dual, 0.05)
    np.testing.assert_array_equal(np.bincount(parts), [100, 100])
    np.testing.assert_array_equal(np.unique(parts[x < 0.5]).size, 1)


def test_no_part_is_small_whatever_the_labels():
    V, F = icosphere(4)
    dual = DualGraph.of(V, F)
    noise = np.random.default_rng(0).integers(0, 3, len(F))
    parts = parts_of(noise, F, dual, 0.02)
    share = np.bincount(parts, weights=dual.area)
    assert share.min() >= 0.02
    assert np.all(np.diff(share) <= 1e-9)
    assert face_components(F, parts).max() == parts.max()


def test_a_small_island_stays_a_part():
    V, F = side_by_side(icosphere(3), (icosphere(1)[0] * 0.02 + 3.0, icosphere(1)[1]))
    np.testing.assert_array_equal(np.bincount(SDFSegmenter().segment(V, F)), [1280, 80])
