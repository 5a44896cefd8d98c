"""The displacement that weighs costs up against chips, its folds, and its fit to the surface."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_matrix
from scipy.spatial.transform import Rotation

from meshmark.mesh.closest_points import ClosestPoints
from meshmark.mesh.geometry import normalized
from meshmark.metrics.surface_distance import mrms
from meshmark.testing.meshes import icosphere, plane, torus
from meshmark_plugins.schemes.apex.linear_algebra.conjugate_gradients import solve
from meshmark_plugins.schemes.apex.marking import solve_displacement as displacing
from meshmark_plugins.schemes.apex.marking.displacement_transfer import DisplacementTransfer
from meshmark_plugins.schemes.apex.marking.energy import energy_over_poses
from meshmark_plugins.schemes.apex.marking.fit_to_surface import fit_to_surface
from meshmark_plugins.schemes.apex.marking.fold_smoother import FoldSmoother
from meshmark_plugins.schemes.apex.marking.pose_constraints import MAX_TARGET_RATIO, chip_targets
from meshmark_plugins.schemes.apex.marking.solve_displacement import (
    LinearConstraints,
    solve_displacement,
)

WIDTH = 0.045
FAR = np.inf
ROTATION = Rotation.from_rotvec([0.4, -1.1, 2.0]).as_matrix()


# Conjugate gradients.


def definite(rng, n):
    A = rng.normal(size=(n, n))
    return A @ A.T + np.diag(rng.uniform(0.5, 50.0, n))


@given(st.integers(0, 2**32 - 1), st.integers(1, 30))
def test_conjugate_gradients_agree_with_elimination(seed, n):
    rng = np.random.default_rng(seed)
    A, b, x = definite(rng, n), rng.normal(size=n), rng.normal(size=n)
    wanted = np.linalg.solve(A, b)
    by_diagonal = solve(A, b, x, 1.0 / np.diag(A), 10 * n, 1e-12)
    np.testing.assert_allclose(by_diagonal, wanted, rtol=1e-6, atol=1e-8)
    # With the inverse for a preconditioner one step is all it takes.
    inverse = np.linalg.inv(A)
    np.testing.assert_allclose(
        solve(A, b, x, lambda r: inverse @ r, 1, 0.0), wanted, rtol=1e-6, atol=1e-8
    )


def test_conjugate_gradients_stop_where_they_are_told_to():
    rng = np.random.default_rng(0)
    A, b, x = definite(rng, 20), rng.normal(size=20), rng.normal(size=20)
    np.testing.assert_array_equal(solve(A, b, x, np.ones(20), 0, 0.0), x)
    exact = np.linalg.solve(A, b)
    np.testing.assert_array_equal(solve(A, A @ exact, exact, np.ones(20), 9, 1e-3), exact)
    np.testing.assert_array_equal(solve(A, 0 * b, 0 * x, np.ones(20), 9, 1e-3), 0.0)
    # A loose tolerance is met after few steps, and not exceeded by many digits.
    errors = [np.linalg.norm(solve(A, b, x, 1 / np.diag(A), 99, t) - exact) for t in (0.1, 1e-4)]
    assert 1e-8 < errors[1] < 0.01 * errors[0]


def unmoved(V):
    """Gradients of a pose that is the reference itself."""
    return V, np.broadcast_to(np.eye(3), (len(V), 3, 3))


# The displacement.


def random_constraints(rng, n, k=4, change=1.0):
    J = csr_matrix(rng.normal(size=(k, 3 * n)) * (rng.random((k, 3 * n)) < 0.5))
    return LinearConstraints(J, np.full(k, change), np.ones(k), rng.uniform(0.5, 2.0, k))


@pytest.fixture
def squares(monkeypatch):
    """Prices that do not depend on the displacement: all is a matter of least squares."""
    for name, value in (("BASE_PRICE", 1.0), ("LACK_PRICE", 0.0), ("STRAIN_LIMIT", np.inf)):
        monkeypatch.setattr(displacing, name, value)


def coarse():
    V, F = icosphere(1)
    return energy_over_poses([unmoved(V)], V, F, WIDTH), len(V)


def dense(energy, n):
    blocks = np.zeros((3 * n, 3 * n))
    for i, block in enumerate(energy.blocks):
        blocks[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = block
    return blocks + np.kron(energy.stretching.matrix().toarray(), np.eye(3))


@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1), poses=st.integers(1, 3))
def test_what_cannot_be_met_is_solved_by_the_normal_equations(squares, seed, poses):
    rng = np.random.default_rng(seed)
    energy, n = coarse()
    # Dear moves: every chip stays short of its target.
    energy = type(energy)(1e4 * energy.blocks, energy.stretching)
    constraints = [random_constraints(rng, n) for _ in range(poses)]
    A, b = dense(energy, n), np.zeros(3 * n)
    for asked in constraints:
        J, price = asked.J.toarray(), asked.price / poses
        A = A + J.T @ (price[:, None] * J)
        b = b + J.T @ (price * asked.change)
    d = solve_displacement(constraints, energy, FAR, np.zeros(3 * n))
    assert all(np.all(asked.J @ d < asked.change) for asked in constraints)
    wanted = np.linalg.solve(A, b)
    np.testing.assert_allclose(d, wanted, atol=1e-6 * np.abs(wanted).max())


@pytest.mark.parametrize("seed", range(4))
def test_where_some_are_met_by_what_the_others_ask_the_rest_is_in_balance(squares, seed):
    rng = np.random.default_rng(seed)
    energy, n = coarse()
    asked = random_constraints(rng, n, 6)
    asked = LinearConstraints(asked.J, rng.normal(size=6), asked.target, asked.price)
    d = solve_displacement([asked], energy, FAR, np.zeros(3 * n))
    short = np.maximum(asked.change - asked.J @ d, 0.0)
    assert np.any(short == 0.0)
    pull = asked.J.T @ (asked.price * short)
    np.testing.assert_allclose(dense(energy, n) @ d, pull, atol=1e-8 * np.abs(pull).max())


def test_chips_beyond_their_targets_and_erasures_ask_for_nothing():
    rng = np.random.default_rng(1)
    energy, n = coarse()
    start = 0.01 * rng.normal(size=3 * n)
    pleased = random_constraints(rng, n, change=-100.0)
    np.testing.assert_allclose(solve_displacement([pleased], energy, FAR, start), 0.0, atol=1e-8)
    erased = LinearConstraints(pleased.J, np.ones(4), np.ones(4), np.zeros(4))
    np.testing.assert_allclose(solve_displacement([erased], energy, FAR, start), 0.0, atol=1e-8)


def test_moves_beyond_their_reach_are_held_back():
    rng = np.random.default_rng(4)
    energy, n = coarse()
    asked, start = random_constraints(rng, n), np.zeros(3 * n)
    longest = [
        np.linalg.norm(
            solve_displacement([asked], energy, reach, start).reshape(-1, 3), axis=1
        ).max()
        for reach in (FAR, 0.1, 0.08, 0.06)
    ]
    assert np.all(np.diff(longest) < 0.0)
    assert longest[-1] < 0.8 * longest[0]


def test_strong_stretches_are_held_back(monkeypatch):
    rng = np.random.default_rng(4)
    energy, n = coarse()
    asked, start = random_constraints(rng, n), np.zeros(3 * n)
    strongest = []
    for limit in (np.inf, 1.0, 0.3, 0.1):
        monkeypatch.setattr(displacing, "STRAIN_LIMIT", limit)
        d = solve_displacement([asked], energy, FAR, start)
        strongest.append(energy.stretching.strains(d).max())
    assert np.all(np.diff(strongest) < 0.0)
    assert strongest[-1] < 0.8 * strongest[0]


def test_what_lacks_most_is_asked_for_most(monkeypatch):
    rng = np.random.default_rng(6)
    energy, n = coarse()
    energy = type(energy)(30.0 * energy.blocks, energy.stretching)
    asked = random_constraints(rng, n, 8)
    worst = []
    for urgent in (0.0, displacing.LACK_PRICE, 30.0):
        monkeypatch.setattr(displacing, "LACK_PRICE", urgent)
        d = solve_displacement([asked], energy, FAR, np.zeros(3 * n))
        lacking = (asked.change - asked.J @ d) / asked.target
        worst.append(lacking.max() / lacking.mean())
    assert np.all(np.diff(worst) < 0.0)


def middle(V):
    """The vertex nearest to the centre."""
    return int(np.argmin(np.linalg.norm(V - V.mean(axis=0), axis=1)))


def test_fewer_vertices_are_driven_farther():
    n = np.array([12.0, 50.0, 100.0, 500.0, 1e9])
    target = chip_targets(n, 0.3)
    assert np.all(np.diff(target) <= 0.0)
    assert target[0] == pytest.approx(MAX_TARGET_RATIO * 0.3)
    assert target[2] == pytest.approx(0.3)
    assert target[-1] > 0.1
    np.testing.assert_allclose(chip_targets(n, 0.15), 0.5 * target)


def test_folds_are_smoothed_out_and_what_does_not_fold_is_left_alone():
    V, F = plane(21)
    smoother = FoldSmoother(F, 1.0, [unmoved(V)])
    calm = 0.01 * np.sin(2 * np.pi * V)
    np.testing.assert_array_equal(smoother.smooth_folds(calm.ravel()), calm.ravel())
    # One vertex jumps over its neighbours.
    jump = calm.copy()
    jump[middle(V)] += [0.11, 0.02, 0.0]
    assert smoother.folded_faces(jump).any()
    smoothed = smoother.smooth_folds(jump.ravel()).reshape(-1, 3)
    assert not smoother.folded_faces(smoothed).any()
    # Far from it nothing moved.
    far = np.linalg.norm(V - V[middle(V)], axis=1) > 0.3
    np.testing.assert_array_equal(smoothed[far], calm[far])


def test_a_fold_in_any_pose_is_smoothed():
    V, F = plane(21)
    jump = np.zeros_like(V)
    jump[middle(V), 0] = 0.04
    # In the second pose the plane is drawn out along y, and moves along x are twice as long.
    G = np.broadcast_to(np.diag([2.0, 3.0, 1.0]), (len(V), 3, 3))
    assert not FoldSmoother(F, 1.0, [unmoved(V)]).folded_faces(jump).any()
    pose = V * [1.0, 3.0, 1.0], G
    assert FoldSmoother(F, 1.0, [unmoved(V), pose]).folded_faces(jump).any()


# The displacement on the surface, and the fit to it.


def test_a_displacement_is_laid_on_the_surface_and_turns_with_it():
    V, F = torus(60, 30)
    transfer = DisplacementTransfer(V, F)
    d = 0.005 * np.random.default_rng(1).normal(size=V.size)
    X, share = transfer.apply(V, d, ClosestPoints(V, F))
    # Where a face would have turned over, moves were shortened, across the bend.
    assert share.min() >= 0.0
    assert np.mean(share == 1.0) > 0.9
    assert ClosestPoints(V, F).distances(X[share == 1.0]).max() < 1e-12
    turned, _ = transfer.apply(V @ ROTATION.T, d, ClosestPoints(V @ ROTATION.T, F))
    np.testing.assert_allclose(turned, X @ ROTATION.T, atol=1e-4)
    still, _ = transfer.apply(V, 0.0 * d, ClosestPoints(V, F))
    np.testing.assert_allclose(still, V, atol=1e-12)


def test_vertices_that_left_a_plane_return_along_its_normal():
    V, F = plane(21)
    bumps = 0.005 * np.random.default_rng(5).normal(size=len(V))
    off = V + bumps[:, None] * [0.0, 0.0, 1.0]
    back = fit_to_surface(off, F, ClosestPoints(V, F))
    assert np.abs(back[:, 2]).max() < 0.01 * np.abs(bumps).max()
    np.testing.assert_array_equal(fit_to_surface(V, F, ClosestPoints(V, F)), V)


@pytest.mark.parametrize("level", [2, 3])
def test_a_fitted_polyhedron_is_nearer_to_its_sphere_than_an_inscribed_one(level):
    ball, (V, F) = icosphere(5), icosphere(level)
    fitted = fit_to_surface(V, F, ClosestPoints(*ball))
    assert mrms(*ball, fitted, F) < 0.3 * mrms(*ball, V, F)
    # Vertices go outwards only, and not beyond the deepest triangle's sag.
    height = np.linalg.norm(fitted, axis=1) - 1.0
    assert height.min() > 0.0
    assert height.max() < 1.0 - np.linalg.norm(V[F].mean(axis=1), axis=1).min()
    np.testing.assert_allclose(normalized(fitted), V, atol=0.01)
