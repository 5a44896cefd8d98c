"""The displacement that weighs costs up against chips."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_matrix

from meshmark.mesh.laplacian import stiffness_matrix
from meshmark.testing.meshes import icosphere
from meshmark_plugins.schemes.apex.marking import solve_displacement as displacing
from meshmark_plugins.schemes.apex.marking.energy import energy_over_poses
from meshmark_plugins.schemes.apex.marking.pose_constraints import MAX_TARGET_RATIO, chip_targets
from meshmark_plugins.schemes.apex.marking.solve_displacement import (
    LinearConstraints,
    solve_displacement,
)

WIDTH = 0.045
FAR = np.inf


def unmoved(V):
    """Gradients of a pose that is the reference itself."""
    return V, np.broadcast_to(np.eye(3), (len(V), 3, 3))


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
    F = energy.stretching.F
    stretching = stiffness_matrix(F, energy.stretching.side_costs(np.ones(len(F))), n)
    return blocks + np.kron(stretching.toarray(), np.eye(3))


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
    np.testing.assert_allclose(dense(energy, n) @ d, pull, atol=1e-6 * np.abs(pull).max())


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


def test_steps_that_overshoot_are_shortened():
    rng, reach = np.random.default_rng(4), 0.004
    energy, n = coarse()
    asked, start = [random_constraints(rng, n)], np.zeros(3 * n)
    problem = displacing._Problem(asked, energy, reach)
    first = problem.at(start)
    step = problem.newton_step(first)
    # From where nothing is dear yet, a step leads uphill in the end.
    assert problem.at(step).gradient @ step > 0.0
    found = problem.at(solve_displacement(asked, energy, reach, start))
    assert np.linalg.norm(found.gradient) < 0.05 * np.linalg.norm(first.gradient)


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


def test_fewer_vertices_are_driven_farther():
    n = np.array([12.0, 50.0, 100.0, 500.0, 1e9])
    target = chip_targets(n, 0.3)
    assert np.all(np.diff(target) <= 0.0)
    assert target[0] == pytest.approx(MAX_TARGET_RATIO * 0.3)
    assert target[2] == pytest.approx(0.3)
    assert target[-1] > 0.1
    np.testing.assert_allclose(chip_targets(n, 0.15), 0.5 * target)
