"""Heights: how steep they are, how much room there is, and which faces they may tilt."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.mesh.flip_guard import face_normals
from meshmark.mesh.geometry import vertex_normals
from meshmark.testing.meshes import cylinder, icosphere, plane, side_by_side
from meshmark_plugins.schemes.relief.height import (
    LEAST_COSINE,
    THICKNESS_SHARE,
    allowed,
    room,
    slope,
)


def turned(V, F, moved) -> np.ndarray:
    """Cosine by which each face turned, (F,)."""
    one, two = face_normals(V, F), face_normals(moved, F)
    return (
        np.einsum("ij,ij->i", one, two) / np.linalg.norm(one, axis=1) / np.linalg.norm(two, axis=1)
    )


@pytest.mark.parametrize("n", [5, 20])
def test_the_slope_of_a_linear_function_is_exact(n) -> None:
    V, F = plane(n, side=7.0)
    assert slope(V, F, 0.03 * V[:, 0] - 0.04 * V[:, 1] + 9.0) == pytest.approx(0.05, rel=1e-12)


def test_the_slope_of_a_harmonic_is_that_of_calculus() -> None:
    V, F = icosphere(5)
    # The gradient of z on the unit sphere has length sin(polar angle): 2/3 in mean square.
    assert slope(V, F, V[:, 2]) == pytest.approx(np.sqrt(2.0 / 3.0), rel=0.01)


def test_the_slope_has_no_unit() -> None:
    V, F = icosphere(3)
    assert slope(5.0 * V, F, 5.0 * V[:, 0] ** 3) == pytest.approx(slope(V, F, V[:, 0] ** 3))


def test_a_sliver_has_no_slope_to_speak_of() -> None:
    V, F = plane(20)
    f = 0.1 * V[:, 0]
    P = np.concatenate([V, V[:1] + np.array([0.0, 1e-9, 0.0])])
    T = np.concatenate([F, [[0, 1, len(V)]]])
    assert slope(P, T, np.append(f, 1.0)) == pytest.approx(0.1, rel=0.01)


@pytest.mark.parametrize("gap", [0.05, 0.3])
def test_room_between_two_planes_is_a_share_of_their_distance(gap) -> None:
    V, F = plane(12)
    both = side_by_side((V, F), (V + np.array([0.0, 0.0, gap]), F))
    inside = np.tile((np.abs(V[:, :2] - 0.5) < 0.49).all(axis=1), 2)
    np.testing.assert_allclose(room(*both)[inside], THICKNESS_SHARE * gap, rtol=2e-3)


def test_a_sheet_alone_has_all_room() -> None:
    assert np.isinf(room(*plane(8))).all()


def test_room_in_a_tube_is_a_share_of_its_diameter() -> None:
    V, F = cylinder(64, 60, radius=0.2, height=4.0)
    side = (np.abs(V[:, 2] - 2.0) < 1.5) & (np.hypot(V[:, 0], V[:, 1]) > 0.19)
    np.testing.assert_allclose(room(V, F)[side], THICKNESS_SHARE * 0.4, rtol=5e-3)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_room_scales_with_the_mesh(scale) -> None:
    V, F = cylinder(32, 30, radius=0.2)
    np.testing.assert_allclose(room(scale * V + scale, F), scale * room(V, F), rtol=1e-3)


def test_a_low_relief_is_allowed_as_it_is() -> None:
    V, F = icosphere(3)
    f = 1e-4 * np.random.default_rng(0).normal(size=len(V))
    np.testing.assert_array_equal(allowed(V, F, f), 1.0)


def test_a_spike_is_held_back_until_no_face_turns_too_far() -> None:
    V, F = plane(15)
    f = 0.2 * np.random.default_rng(1).normal(size=len(V))
    n = vertex_normals(V, F)
    assert turned(V, F, V + f[:, None] * n).min() < LEAST_COSINE
    share = allowed(V, F, f)
    assert share.min() >= 0.0
    assert share.max() <= 1.0
    assert turned(V, F, V + (share * f)[:, None] * n).min() >= LEAST_COSINE - 1e-12
