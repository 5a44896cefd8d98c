"""The basis: a linear map of chips to heights, its transpose, and its size."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshmark.mesh.animation import Frame
from meshmark.mesh.geometry import vertex_areas
from meshmark.mesh.topology import Topology
from meshmark.testing.meshes import icosphere, plane, side_by_side, torus
from meshmark_plugins.schemes.relief.basis import (
    COARSE_SHARE,
    Basis,
    Level,
    Smoother,
    mixed,
    unmixed,
)
from meshmark_plugins.schemes.relief.scheme import Relief

SHAPES = {
    "sphere": icosphere(3),
    "torus": torus(48, 20),
    "plane": plane(24),
    "two": side_by_side(icosphere(2), (icosphere(2)[0] + (3.0, 0.0, 0.0), icosphere(2)[1])),
}


@pytest.fixture(params=SHAPES)
def mesh(request):
    return SHAPES[request.param]


def signs(basis: Basis, n: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).choice((-1.0, 1.0), (n, basis.n_chips))


def test_the_adjoint_is_the_transpose(mesh) -> None:
    V, F = mesh
    rng = np.random.default_rng(1)
    basis = Basis.of(V, F)
    w, x = rng.normal(size=basis.n_chips), rng.normal(size=len(V))
    assert basis.heights(w) @ x == pytest.approx(w @ basis.adjoint(x), abs=1e-10)
    for level in basis.levels:
        w, x = rng.normal(size=(level.n_chips, 3)), rng.normal(size=(len(V), 3))
        np.testing.assert_allclose(level.heights(w).T @ x, w.T @ level.adjoint(x), atol=1e-10)


def test_heights_of_random_words_have_unit_mean_square(mesh) -> None:
    basis = Basis.of(*mesh)
    m = vertex_areas(*mesh)
    # Other words than those by which the gain was found.
    f = np.array([basis.heights(w) for w in signs(basis, 64, seed=7)])
    rms = np.sqrt((f**2 @ m / m.sum()).mean())
    assert rms == pytest.approx(1.0, abs=0.05)


def test_levels_share_the_energy_and_the_fine_one_has_four_times_the_chips(mesh) -> None:
    basis = Basis.of(*mesh)
    m = vertex_areas(*mesh)
    coarse, fine = basis.levels
    assert fine.n_chips == pytest.approx(4 * coarse.n_chips, rel=0.1)
    w = signs(basis, 64, seed=8)
    w[:, coarse.n_chips :] = 0.0
    f = np.array([basis.heights(each) for each in w])
    assert (f**2 @ m / m.sum()).mean() == pytest.approx(COARSE_SHARE, rel=0.1)
    assert basis.shares.sum() == pytest.approx(1.0)


@settings(max_examples=30)
@given(st.integers(1, 200), st.integers(0, 10**6))
def test_mixing_is_a_rotation(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    w, h = rng.normal(size=(n, 2)), rng.normal(size=(n, 2))
    np.testing.assert_allclose(unmixed(mixed(w)), w, atol=1e-12)
    np.testing.assert_allclose(mixed(unmixed(h)), h, atol=1e-12)
    np.testing.assert_allclose(mixed(w).T @ h, w.T @ unmixed(h), atol=1e-10)
    np.testing.assert_allclose(mixed(w[:, 0]), mixed(w)[:, 0], atol=1e-12)


def test_mixed_signs_are_spread_like_a_normal_distribution() -> None:
    w = np.random.default_rng(2).choice((-1.0, 1.0), 3200)
    h = mixed(w)
    assert h.std() == pytest.approx(1.0, abs=0.05)
    # The fourth moment of signs is 1, that of a normal distribution 3.
    assert (h**4).mean() == pytest.approx(3.0, abs=0.4)


def test_smoothing_keeps_constants_and_the_mean(mesh) -> None:
    V, F = mesh
    smoother = Smoother(V, F, 0.3)
    x = np.random.default_rng(3).normal(size=len(V))
    np.testing.assert_allclose(smoother(np.ones(len(V))), 1.0, atol=1e-9)
    assert smoother.mass @ smoother(x) == pytest.approx(smoother.mass @ x, abs=1e-10)
    y = np.random.default_rng(4).normal(size=len(V))
    assert smoother(x) @ y == pytest.approx(x @ smoother.adjoint(y), abs=1e-10)
    assert np.abs(smoother(x)).max() < np.abs(x).max()


def test_a_harmonic_is_damped_as_the_equation_says() -> None:
    V, F = icosphere(4)
    radius = 0.4
    # The Laplacian's eigenvalue of a linear function on the unit sphere is 2.
    damped = Smoother(V, F, radius)(V[:, 2])
    np.testing.assert_allclose(damped, V[:, 2] / (1.0 + 2.0 * radius**2), atol=0.003)


def test_what_is_smooth_passes_and_a_relief_does_not(mesh) -> None:
    basis = Basis.of(*mesh)
    count = np.random.default_rng(5).uniform(0.5, 1.5, (len(mesh[0]), 2))
    slow = np.full(count.shape, (3.0, -1.0))
    np.testing.assert_allclose(basis.low_pass(slow, count), slow, atol=1e-9)
    f = basis.heights(signs(basis, 2, seed=9).T)
    assert np.all(basis.low_pass(f, count).std(axis=0) < 0.5 * f.std(axis=0))


def test_squares_are_the_diagonal_on_average(mesh) -> None:
    basis = Basis.of(*mesh)
    x = np.random.default_rng(6).uniform(0.0, 1.0, len(mesh[0]))
    B = np.stack([basis.heights(w) for w in np.eye(basis.n_chips)], axis=1)
    exact = np.einsum("ij,ij,i->j", B, B, x)
    assert basis.squares(x).sum() == pytest.approx(exact.sum(), rel=0.3)


def test_a_small_mesh_has_one_level() -> None:
    basis = Basis.of(*icosphere(1))
    assert len(basis.levels) == 1
    assert basis.shares.tolist() == [1.0]
    assert basis.n_chips == 42 // 3


def test_a_level_sums_values_over_its_patches() -> None:
    V, F = icosphere(2)
    level = Level(V, F, 20)
    x = np.arange(float(len(V)))
    expected = [x[level.label == k].sum() for k in range(level.n_chips)]
    np.testing.assert_allclose(level.by_patch(x), expected)
    np.testing.assert_allclose(
        level.by_patch(np.stack([x, 2 * x], axis=1))[:, 1], 2 * level.by_patch(x)
    )


def test_a_surface_is_laid_out_once_to_be_marked_and_read() -> None:
    V, F = SHAPES["torus"]
    topology = Topology.from_triangles(F, len(V))
    marked = Relief().layout(Frame(1.0, V, topology))
    again = Relief(slope=0.1).layout(Frame(2.0, V.copy(), Topology.from_triangles(F, len(V))))
    assert again.basis is marked.basis
    assert again.height < marked.height
    moved = Relief().layout(Frame(1.0, V + 1e-9, topology))
    assert moved.basis is not marked.basis
