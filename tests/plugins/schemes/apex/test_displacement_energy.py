"""What moves cost: sliding, stretching, guards about anchors, poses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from meshmark.mesh.geometry import face_areas, vertex_areas
from meshmark.mesh.laplacian import stiffness_matrix
from meshmark.testing.meshes import bumpy_sphere, icosphere, plane, torus
from meshmark_plugins.schemes.apex.marking.energy import (
    GUARD_RADIUS,
    MIN_MOBILITY,
    energy_over_poses,
    guard_weights,
)
from meshmark_plugins.schemes.apex.marking.sliding import REFERENCE_SPREAD, SlidingCost
from meshmark_plugins.schemes.apex.marking.stretching import STRETCHING_WEIGHT, stretching_energy

WIDTH = 0.045
FAR = np.inf
ROTATION = Rotation.from_rotvec([0.4, -1.1, 2.0]).as_matrix()


def inner(V):
    """Which vertices of `plane` are not on its border."""
    low, high = V[:, :2].min(axis=0), V[:, :2].max(axis=0)
    return np.all((V[:, :2] > low) & (V[:, :2] < high), axis=1)


def on_right(V):
    """Which vertices of `plane` are on one of its sides, but for its corners."""
    across = V[:, 1] - V[:, 1].mean()
    return (V[:, 0] == V[:, 0].max()) & (np.abs(across) < 0.9 * across.max())


def test_sliding_along_a_plane_costs_one_and_leaving_it_much_more():
    V, F = plane(5)
    cost = SlidingCost(F).cost(V)[inner(V)]
    np.testing.assert_allclose(
        cost, np.broadcast_to(np.diag([1, 1, 1 + 1 / REFERENCE_SPREAD]), cost.shape)
    )


def test_leaving_a_border_costs_and_sliding_along_it_does_not():
    V, F = plane(9)
    cost = SlidingCost(F).cost(V)
    assert np.all(cost[on_right(V), 0, 0] > 0.1 / REFERENCE_SPREAD)
    np.testing.assert_allclose(cost[on_right(V), 1, 1], 1.0)


def test_the_rim_of_a_thin_sheet_holds_where_its_normals_do_not():
    # Two sheets back to back, sewn together along their borders: all normals are z or -z.
    V, F = plane(9)
    border = ~inner(V)
    back = np.where(border, np.arange(len(V)), len(V) + np.cumsum(~border) - 1)
    sheet = np.concatenate([F, back[F][:, ::-1]])
    both = np.concatenate([V, V[~border]])
    sliding = SlidingCost(sheet)
    right = on_right(both)
    np.testing.assert_allclose(sliding.normal_spread(both)[right, 0, 0], 0.0, atol=1e-12)
    assert np.all(sliding.cost(both)[right, 0, 0] > 0.3 / REFERENCE_SPREAD)
    np.testing.assert_allclose(sliding.cost(both)[right, 1, 1], 1.0)


def test_rims_turn_with_the_mesh_and_are_small_on_what_is_smooth():
    rims = []
    for level in (2, 3):
        V, F = icosphere(level)
        sliding = SlidingCost(F)
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
    cost = SlidingCost(F).cost(V)
    assert np.linalg.eigvalsh(cost)[:, 0].min() >= 1.0
    # Along the outer rim the way around the tube bends more than the one around the axis.
    rim = np.argmax(V[:, 0])
    assert cost[rim, 1, 1] < cost[rim, 2, 2] < 0.1 * cost[rim, 0, 0]


def test_stretching_costs_the_square_of_the_slope_and_shifting_nothing():
    V, F = plane(9, side=3.0)

    def cost(energy, factor):
        return stiffness_matrix(F, energy.side_costs(factor * np.ones(len(F))), len(V))

    S = cost(stretching_energy(V, F, WIDTH), 1.0)
    d = 2.0 * V[:, 0] - V[:, 1]
    assert d @ S @ d == pytest.approx(STRETCHING_WEIGHT * (WIDTH / (2 * np.pi)) ** 2 * 5.0 * 9.0)
    np.testing.assert_allclose(S @ np.ones(len(V)), 0.0, atol=1e-15)
    larger = cost(stretching_energy(100.0 * V, F, WIDTH), 1.0)
    np.testing.assert_allclose(larger.toarray(), S.toarray(), atol=1e-15)
    dearer = cost(stretching_energy(V, F, WIDTH), 3.0)
    np.testing.assert_allclose(dearer.toarray(), 3.0 * S.toarray(), atol=1e-15)


@given(st.integers(0, 2**32 - 1), st.floats(0.1, 10.0))
@settings(max_examples=20)
def test_the_strain_of_a_linear_displacement_is_that_of_its_matrix(seed, side):
    rng = np.random.default_rng(seed)
    V, F = plane(6, side=side)
    V = V + 0.02 * side * rng.normal(size=V.shape) * [1.0, 1.0, 0.0]
    A = rng.normal(size=(3, 3))
    stretching = stretching_energy(V, F, WIDTH)
    root_area = np.sqrt(face_areas(V, F).sum())
    strains = stretching.strains((V @ A.T / root_area).ravel())
    # What A does to lengths in the plane; its third column is not asked.
    np.testing.assert_allclose(strains, np.linalg.norm(A[:, :2]), rtol=1e-9)


def test_anchors_are_guarded_and_what_is_far_from_them_is_free():
    H = np.array(
        [
            [0.0, GUARD_RADIUS, 10 * GUARD_RADIUS, 10 * GUARD_RADIUS],
            [10 * GUARD_RADIUS, 10 * GUARD_RADIUS, 0.0, 10 * GUARD_RADIUS],
        ]
    )
    wanted = [MIN_MOBILITY**-2, (1 - np.exp(-1)) ** -2, MIN_MOBILITY**-2, 1.0]
    np.testing.assert_allclose(guard_weights(H), wanted)


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
