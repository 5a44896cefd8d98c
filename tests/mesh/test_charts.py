"""Where vertices that slid lie on the old surface, where that is known; and seams."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshmark.mesh.charts import Charts, cut_along_seams, equal_rows, turned_along
from meshmark.testing.meshes import icosphere, plane

UP = np.array([0.0, 0.0, 1.0])


def slid(V: np.ndarray, seed: int, share: float, edge: float) -> np.ndarray:
    """Move every vertex within the xy-plane by up to a share of an edge."""
    step = np.random.default_rng(seed).uniform(-1, 1, (len(V), 2)) * share * edge
    return V + np.column_stack([step, np.zeros(len(V))])


@settings(max_examples=25)
@given(st.integers(0, 999), st.sampled_from([0.01, 0.4, 1.0, 2.5]))
def test_on_a_plane_the_value_is_that_of_the_new_place(seed: int, share: float) -> None:
    V, F = plane(12)
    X = slid(V, seed, share, 1 / 11)
    places = Charts.whole(F, len(V)).places(V, X)
    inside = np.all((X >= 0) & (X <= 1), axis=1)
    found = places.values(V[:, :2], continued=True)
    # The square is continued, but not for ever.
    exact = inside | (share < 1)
    np.testing.assert_allclose(found[exact], X[exact, :2], atol=1e-12)
    clamped = places.values(V[:, :2])
    np.testing.assert_allclose(clamped[inside], X[inside, :2], atol=1e-12)
    assert clamped.min() >= 0
    assert clamped.max() <= 1


def test_a_move_out_of_the_surface_changes_nothing() -> None:
    V, F = plane(8)
    places = Charts.whole(F, len(V)).places(V, V + 0.3 * UP)
    np.testing.assert_allclose(places.values(V), V, atol=1e-12)


def test_what_does_not_move_or_has_no_face_keeps_its_bits() -> None:
    V, F = plane(5)
    V = np.concatenate([V, [[7.0, 7, 7]]])
    X = V.copy()
    X[[12, 25]] += 0.01
    values = np.random.default_rng(0).random((len(V), 1)) / 3
    found = Charts.whole(F, len(V)).places(V, X).values(values)
    assert np.flatnonzero((found != values).any(axis=1)).tolist() == [12]


def test_the_other_side_of_a_thin_sheet_is_never_meant() -> None:
    V, F = plane(9)
    # Two sheets, a hundredth of an edge apart, that share their border.
    inner = np.all((V[:, :2] > 0) & (V[:, :2] < 1), axis=1)
    n = len(V)
    low = np.where(inner, n + np.cumsum(inner) - 1, np.arange(n))
    P = np.concatenate([V + UP * np.where(inner, 0.001, 0.0)[:, None], V[inner]])
    faces = np.concatenate([F, low[F][:, ::-1]])
    top = np.concatenate([inner, np.zeros(inner.sum(), dtype=bool)])
    # Vertices of the upper sheet sink below the lower one.
    X = P - 0.002 * UP * top[:, None]
    side = np.concatenate([np.ones(n), -np.ones(inner.sum())])[:, None]
    found = Charts.whole(faces, len(P)).places(P, X).values(side)
    np.testing.assert_array_equal(found[top], 1.0)


def on_sphere(level: int = 4):
    """Return a sphere, its corners' longitude and latitude, with a seam at 180 degrees."""
    V, F = icosphere(level)
    V = V @ np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    F = F[np.abs(V[F][..., 2]).max(axis=1) < 0.9]
    u = np.arctan2(V[:, 1], V[:, 0])[F] / (2 * np.pi)
    u = np.where(u < u.max(axis=1, keepdims=True) - 0.5, u + 1.0, u)
    return V, F, np.stack([u, V[F][..., 2]], axis=2)


def test_no_value_on_a_sphere_mixes_the_charts_of_a_seam() -> None:
    V, F, uv = on_sphere()
    corners = np.arange(F.size).reshape(F.shape)
    row = cut_along_seams(F, corners, F.ravel(), equal_rows(uv.reshape(-1, 2)))
    first = np.unique(row, return_index=True)[1]
    vertices = F.ravel()[first]
    seam = np.flatnonzero(np.bincount(vertices, minlength=len(V)) > 1)
    assert 10 < len(seam) < 40
    a = 0.03
    R = np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]])
    places = Charts(row[corners], vertices).places(V, V @ R)
    values = uv.reshape(-1, 2)[first]
    found = places.values(values, continued=True)
    # Every row goes on by the angle; mixed charts would be off by up to a whole turn.
    np.testing.assert_allclose(found[:, 0] - values[:, 0], a / (2 * np.pi), atol=5e-4)
    np.testing.assert_allclose(found[:, 1], values[:, 1], atol=3e-3)
    clamped = places.values(values)
    assert np.abs(clamped[:, 0] - values[:, 0]).max() < 2 * a / (2 * np.pi)


def test_corners_share_a_row_unless_a_seam_parts_them() -> None:
    # Two quads as fans; 1 and 4 are shared, and 4 has another value in the second quad.
    F = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])
    corners = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    vertices = np.array([0, 1, 4, 3, 1, 2, 5, 4])
    whole = cut_along_seams(F, corners, vertices, vertices)
    assert whole.tolist() == [0, 1, 4, 3, 1, 2, 5, 4]
    cut = cut_along_seams(F, corners, vertices, np.array([0, 1, 4, 3, 1, 2, 5, 9]))
    # The edge 1-4 is a seam, so that 1 has two rows although its values are the same.
    assert cut[1] != cut[4]
    assert cut[2] != cut[7]
    assert len(set(cut.tolist())) == 8


def test_degenerate_faces_do_no_harm() -> None:
    V, F = plane(6)
    F = np.concatenate([[[7, 7, 8], [7, 8, 9]], F])
    X = slid(V, 0, 0.3, 0.2)
    found = Charts.whole(F, len(V)).places(V, X).values(V[:, :2])
    assert np.isfinite(found).all()
    assert np.abs(found - V[:, :2]).max() < 0.4


@pytest.mark.parametrize("seed", range(3))
def test_vectors_turn_as_others_do(seed: int) -> None:
    a, b, x = np.random.default_rng(seed).normal(size=(3, 50, 3))
    a, b = (y / np.linalg.norm(y, axis=1, keepdims=True) for y in (a, b))
    np.testing.assert_allclose(turned_along(a, a, b), b, atol=1e-9)
    turned = turned_along(x, a, b)
    for y, z in ((x, x), (a, x)):
        before = np.einsum("ij,ij->i", y, z)
        after = np.einsum("ij,ij->i", turned_along(y, a, b), turned)
        np.testing.assert_allclose(after, before, atol=1e-9)
    np.testing.assert_array_equal(turned_along(x, a, -a), x)
    np.testing.assert_array_equal(turned_along(x, 0 * a, b), x)
