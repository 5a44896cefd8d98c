"""What moves cost, the displacement that weighs it up against chips, and the refit after it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_matrix
from scipy.spatial.transform import Rotation

from meshmark.geometry import face_areas, unit, vertex_areas
from meshmark.surface import ClosestPoints
from meshmark.surface_distance import mrms
from meshmark.testing.meshes import bumpy_sphere, icosphere, plane, torus
from meshmark_plugins.schemes.apex import displacement as displacing
from meshmark_plugins.schemes.apex.conjugate_gradients import solve
from meshmark_plugins.schemes.apex.displacement import Demand, displacement
from meshmark_plugins.schemes.apex.energy import (
    GUARD,
    LEAST_MOBILITY,
    energy_over_poses,
    guarded,
)
from meshmark_plugins.schemes.apex.folds import Folds
from meshmark_plugins.schemes.apex.poses import MOST, Cover, targets
from meshmark_plugins.schemes.apex.refit import refit
from meshmark_plugins.schemes.apex.sliding import FLATNESS, Sliding
from meshmark_plugins.schemes.apex.stretching import STIFFNESS, stretching_cost

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


# The cost of moves.


def inner(V):
    """Which vertices of `plane` are not on its border."""
    low, high = V[:, :2].min(axis=0), V[:, :2].max(axis=0)
    return np.all((V[:, :2] > low) & (V[:, :2] < high), axis=1)


def on_right(V):
    """Which vertices of `plane` are on one of its sides, but for its corners."""
    across = V[:, 1] - V[:, 1].mean()
    return (V[:, 0] == V[:, 0].max()) & (np.abs(across) < 0.9 * across.max())


def middle(V):
    """The vertex nearest to the centre."""
    return int(np.argmin(np.linalg.norm(V - V.mean(axis=0), axis=1)))


def test_sliding_along_a_plane_costs_one_and_leaving_it_much_more():
    V, F = plane(5)
    cost = Sliding(F, len(V)).cost(V)[inner(V)]
    np.testing.assert_allclose(cost, np.broadcast_to(np.diag([1, 1, 1 + 1 / FLATNESS]), cost.shape))


def test_leaving_a_border_costs_and_sliding_along_it_does_not():
    V, F = plane(9)
    cost = Sliding(F, len(V)).cost(V)
    assert np.all(cost[on_right(V), 0, 0] > 0.1 / FLATNESS)
    np.testing.assert_allclose(cost[on_right(V), 1, 1], 1.0)


def test_the_rim_of_a_thin_sheet_holds_where_its_normals_do_not():
    # Two sheets back to back, sewn together along their borders: all normals are z or -z.
    V, F = plane(9)
    border = ~inner(V)
    back = np.where(border, np.arange(len(V)), len(V) + np.cumsum(~border) - 1)
    sheet = np.concatenate([F, back[F][:, ::-1]])
    both = np.concatenate([V, V[~border]])
    sliding = Sliding(sheet, len(both))
    right = on_right(both)
    np.testing.assert_allclose(sliding.normal_spread(both)[right, 0, 0], 0.0, atol=1e-12)
    assert np.all(sliding.cost(both)[right, 0, 0] > 0.3 / FLATNESS)
    np.testing.assert_allclose(sliding.cost(both)[right, 1, 1], 1.0)


def test_rims_turn_with_the_mesh_and_are_small_on_what_is_smooth():
    rims = []
    for level in (2, 3):
        V, F = icosphere(level)
        sliding = Sliding(F, len(V))
        turned = ROTATION @ sliding.rim_spread(V) @ ROTATION.T
        np.testing.assert_allclose(sliding.rim_spread(V @ ROTATION.T), turned, atol=1e-12)
        # All of it along the normals, which cost as much already.
        along = np.einsum("ni,nij,nj->n", V, sliding.rim_spread(V), V)
        np.testing.assert_allclose(
            along, np.trace(sliding.rim_spread(V), axis1=1, axis2=2), rtol=0.05
        )
        rims.append(along.mean())
    # The square of the angle between neighbours, which a finer mesh halves.
    assert rims[0] / rims[1] == pytest.approx(4.0, rel=0.1)


def test_sliding_over_a_bend_costs_more():
    V, F = torus(60, 30)
    cost = Sliding(F, len(V)).cost(V)
    assert np.linalg.eigvalsh(cost)[:, 0].min() >= 1.0
    # Along the outer rim the way around the tube bends more than the one around the axis.
    rim = np.argmax(V[:, 0])
    assert cost[rim, 1, 1] < cost[rim, 2, 2] < 0.1 * cost[rim, 0, 0]


def test_stretching_costs_the_square_of_the_slope_and_shifting_nothing():
    V, F = plane(9, side=3.0)
    S = stretching_cost(V, F, WIDTH).matrix()
    d = 2.0 * V[:, 0] - V[:, 1]
    assert d @ S @ d == pytest.approx(STIFFNESS * (WIDTH / (2 * np.pi)) ** 2 * 5.0 * 9.0)
    np.testing.assert_allclose(S @ np.ones(len(V)), 0.0, atol=1e-15)
    larger = stretching_cost(100.0 * V, F, WIDTH).matrix()
    np.testing.assert_allclose(larger.toarray(), S.toarray(), atol=1e-15)
    dearer = stretching_cost(V, F, WIDTH).matrix(np.full(len(F), 3.0))
    np.testing.assert_allclose(dearer.toarray(), 3.0 * S.toarray(), atol=1e-15)


@given(st.integers(0, 2**32 - 1), st.floats(0.1, 10.0))
@settings(max_examples=20, deadline=None)
def test_the_strain_of_a_linear_displacement_is_that_of_its_matrix(seed, side):
    rng = np.random.default_rng(seed)
    V, F = plane(6, side=side)
    V = V + 0.05 * side * rng.normal(size=V.shape) * [1.0, 1.0, 0.0]
    A = rng.normal(size=(3, 3))
    stretching = stretching_cost(V, F, WIDTH)
    root_area = np.sqrt(face_areas(V, F).sum())
    strains = stretching.strains((V @ A.T / root_area).ravel())
    # What A does to lengths in the plane; its third column is not asked.
    np.testing.assert_allclose(strains, np.linalg.norm(A[:, :2]), rtol=1e-9)


def test_anchors_are_guarded_and_what_is_far_from_them_is_free():
    H = np.array([[0.0, GUARD, 10 * GUARD, 10 * GUARD], [10 * GUARD, 10 * GUARD, 0.0, 10 * GUARD]])
    wanted = [LEAST_MOBILITY**-2, (1 - np.exp(-1)) ** -2, LEAST_MOBILITY**-2, 1.0]
    np.testing.assert_allclose(guarded(H), wanted)


def unmoved(V):
    """Gradients of a pose that is the reference itself."""
    return V, np.broadcast_to(np.eye(3), (len(V), 3, 3))


def test_a_pose_that_is_only_turned_costs_the_same():
    V, F = bumpy_sphere(2, np.array([[1.0, 2, 0], [0, -1, 3]]))
    turned = V @ ROTATION.T, np.broadcast_to(ROTATION, (len(V), 3, 3))
    one, two = (
        energy_over_poses(poses, V, F, WIDTH) for poses in ([unmoved(V)], [unmoved(V), turned])
    )
    np.testing.assert_allclose(two.blocks, one.blocks, atol=1e-12)


def test_a_shift_along_a_plane_costs_the_share_of_the_area_that_is_moved():
    V, F = plane(9)
    energy = energy_over_poses([unmoved(V)], V, F, WIDTH)
    share = vertex_areas(V, F) / face_areas(V, F).sum()
    np.testing.assert_allclose(energy.blocks[inner(V), 0, 0], share[inner(V)])
    # Stretching costs nothing where all move alike, whatever a vertex' own move costs.
    shift = np.tile([1.0, 0.0, 0.0], len(V))
    cost = energy.weighted(np.ones(len(V)), np.full(len(F), 7.0))
    assert shift @ (cost @ shift) == pytest.approx(energy.blocks[:, 0, 0].sum())


# The displacement.


def demand(rng, n, k=4, change=1.0):
    J = csr_matrix(rng.normal(size=(k, 3 * n)) * (rng.random((k, 3 * n)) < 0.5))
    return Demand(J, np.full(k, change), np.ones(k), rng.uniform(0.5, 2.0, k))


@pytest.fixture
def squares(monkeypatch):
    """Prices that do not depend on the displacement: all is a matter of least squares."""
    for name, value in (("CALM", 1.0), ("URGENT", 0.0), ("STRAIN", np.inf)):
        monkeypatch.setattr(displacing, name, value)


def coarse():
    V, F = icosphere(1)
    return energy_over_poses([unmoved(V)], V, F, WIDTH), len(V)


def dense(energy, n):
    blocks = np.zeros((3 * n, 3 * n))
    for i, block in enumerate(energy.blocks):
        blocks[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = block
    return blocks + np.kron(energy.stretching.matrix().toarray(), np.eye(3))


@settings(
    max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(seed=st.integers(0, 2**32 - 1), poses=st.integers(1, 3))
def test_what_cannot_be_met_is_solved_by_the_normal_equations(squares, seed, poses):
    rng = np.random.default_rng(seed)
    energy, n = coarse()
    # Dear moves: every chip stays short of its target.
    energy = type(energy)(1e4 * energy.blocks, energy.stretching)
    demands = [demand(rng, n) for _ in range(poses)]
    A, b = dense(energy, n), np.zeros(3 * n)
    for asked in demands:
        J, price = asked.J.toarray(), asked.weight / poses
        A = A + J.T @ (price[:, None] * J)
        b = b + J.T @ (price * asked.change)
    d = displacement(demands, energy, FAR, np.zeros(3 * n))
    assert all(np.all(asked.J @ d < asked.change) for asked in demands)
    wanted = np.linalg.solve(A, b)
    np.testing.assert_allclose(d, wanted, atol=1e-6 * np.abs(wanted).max())


@pytest.mark.parametrize("seed", range(4))
def test_where_some_are_met_by_what_the_others_ask_the_rest_is_in_balance(squares, seed):
    rng = np.random.default_rng(seed)
    energy, n = coarse()
    asked = demand(rng, n, 6)
    asked = Demand(asked.J, rng.normal(size=6), asked.target, asked.weight)
    d = displacement([asked], energy, FAR, np.zeros(3 * n))
    short = np.maximum(asked.change - asked.J @ d, 0.0)
    assert np.any(short == 0.0)
    pull = asked.J.T @ (asked.weight * short)
    np.testing.assert_allclose(dense(energy, n) @ d, pull, atol=1e-8 * np.abs(pull).max())


def test_chips_beyond_their_targets_and_erasures_ask_for_nothing():
    rng = np.random.default_rng(1)
    energy, n = coarse()
    start = 0.01 * rng.normal(size=3 * n)
    pleased = demand(rng, n, change=-100.0)
    np.testing.assert_allclose(displacement([pleased], energy, FAR, start), 0.0, atol=1e-8)
    erased = Demand(pleased.J, np.ones(4), np.ones(4), np.zeros(4))
    np.testing.assert_allclose(displacement([erased], energy, FAR, start), 0.0, atol=1e-8)


def test_moves_beyond_their_reach_are_held_back():
    rng = np.random.default_rng(4)
    energy, n = coarse()
    asked, start = demand(rng, n), np.zeros(3 * n)
    longest = [
        np.linalg.norm(displacement([asked], energy, reach, start).reshape(-1, 3), axis=1).max()
        for reach in (FAR, 0.1, 0.08, 0.06)
    ]
    assert np.all(np.diff(longest) < 0.0)
    assert longest[-1] < 0.8 * longest[0]


def test_strong_stretches_are_held_back(monkeypatch):
    rng = np.random.default_rng(4)
    energy, n = coarse()
    asked, start = demand(rng, n), np.zeros(3 * n)
    strongest = []
    for limit in (np.inf, 1.0, 0.3, 0.1):
        monkeypatch.setattr(displacing, "STRAIN", limit)
        d = displacement([asked], energy, FAR, start)
        strongest.append(energy.stretching.strains(d).max())
    assert np.all(np.diff(strongest) < 0.0)
    assert strongest[-1] < 0.8 * strongest[0]


def test_what_lacks_most_is_asked_for_most(monkeypatch):
    rng = np.random.default_rng(6)
    energy, n = coarse()
    energy = type(energy)(30.0 * energy.blocks, energy.stretching)
    asked = demand(rng, n, 8)
    worst = []
    for urgent in (0.0, displacing.URGENT, 30.0):
        monkeypatch.setattr(displacing, "URGENT", urgent)
        d = displacement([asked], energy, FAR, np.zeros(3 * n))
        lacking = (asked.change - asked.J @ d) / asked.target
        worst.append(lacking.max() / lacking.mean())
    assert np.all(np.diff(worst) < 0.0)


def test_fewer_vertices_are_driven_farther():
    n = np.array([12.0, 50.0, 100.0, 500.0, 1e9])
    target = targets(n, 0.3)
    assert np.all(np.diff(target) <= 0.0)
    assert target[0] == pytest.approx(MOST * 0.3)
    assert target[2] == pytest.approx(0.3)
    assert target[-1] > 0.1
    np.testing.assert_allclose(targets(n, 0.15), 0.5 * target)


def test_folds_are_ironed_out_and_what_does_not_fold_is_left_alone():
    V, F = plane(21)
    folds = Folds(F, 1.0, [unmoved(V)])
    calm = 0.01 * np.sin(2 * np.pi * V)
    np.testing.assert_array_equal(folds.ironed(calm.ravel()), calm.ravel())
    # One vertex jumps over its neighbours.
    jump = calm.copy()
    jump[middle(V)] += [0.11, 0.02, 0.0]
    assert folds.found(jump).any()
    ironed = folds.ironed(jump.ravel()).reshape(-1, 3)
    assert not folds.found(ironed).any()
    # Far from it nothing moved.
    far = np.linalg.norm(V - V[middle(V)], axis=1) > 0.3
    np.testing.assert_array_equal(ironed[far], calm[far])


def test_a_fold_in_any_pose_is_ironed():
    V, F = plane(21)
    jump = np.zeros_like(V)
    jump[middle(V), 0] = 0.04
    # In the second pose the plane is drawn out along y, and moves along x are twice as long.
    G = np.broadcast_to(np.diag([2.0, 3.0, 1.0]), (len(V), 3, 3))
    assert not Folds(F, 1.0, [unmoved(V)]).found(jump).any()
    pose = V * [1.0, 3.0, 1.0], G
    assert Folds(F, 1.0, [unmoved(V), pose]).found(jump).any()


# The displacement on the surface, and the refit.


def test_a_displacement_is_laid_on_the_surface_and_turns_with_it():
    V, F = torus(60, 30)
    cover = Cover(V, F)
    d = 0.005 * np.random.default_rng(1).normal(size=V.size)
    X, share = cover.laid(V, d, ClosestPoints(V, F))
    # Where a face would have turned over, moves were shortened, across the bend.
    assert share.min() >= 0.0
    assert np.mean(share == 1.0) > 0.9
    assert ClosestPoints(V, F).distances(X[share == 1.0]).max() < 1e-12
    turned, _ = cover.laid(V @ ROTATION.T, d, ClosestPoints(V @ ROTATION.T, F))
    np.testing.assert_allclose(turned, X @ ROTATION.T, atol=1e-4)
    still, _ = cover.laid(V, 0.0 * d, ClosestPoints(V, F))
    np.testing.assert_allclose(still, V, atol=1e-12)


def test_vertices_that_left_a_plane_return_along_its_normal():
    V, F = plane(21)
    bumps = 0.005 * np.random.default_rng(5).normal(size=len(V))
    off = V + bumps[:, None] * [0.0, 0.0, 1.0]
    back = refit(off, F, ClosestPoints(V, F))
    assert np.abs(back[:, 2]).max() < 0.01 * np.abs(bumps).max()
    np.testing.assert_array_equal(refit(V, F, ClosestPoints(V, F)), V)


@pytest.mark.parametrize("level", [2, 3])
def test_a_refitted_polyhedron_is_nearer_to_its_sphere_than_an_inscribed_one(level):
    ball, (V, F) = icosphere(5), icosphere(level)
    fitted = refit(V, F, ClosestPoints(*ball))
    assert mrms(*ball, fitted, F) < 0.3 * mrms(*ball, V, F)
    # Vertices go outwards only, and not beyond the deepest triangle's sag.
    height = np.linalg.norm(fitted, axis=1) - 1.0
    assert height.min() > 0.0
    assert height.max() < 1.0 - np.linalg.norm(V[F].mean(axis=1), axis=1).min()
    np.testing.assert_allclose(unit(fitted), V, atol=0.01)
