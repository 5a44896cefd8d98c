"""The closest of many triangles, against all of them."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from meshmark.mesh import triangle_search as searching
from meshmark.mesh.closest_in_triangle import closest_in_triangle
from meshmark.mesh.closest_points import ClosestPoints
from meshmark.testing.meshes import icosphere

needs_numba = pytest.mark.skipif(find_spec("numba") is None, reason="numba is not installed")


def squares(V, F, Q):
    """Squared distance of each query from each triangle, (n, F)."""
    P, f = (x.ravel() for x in np.meshgrid(np.arange(len(Q)), np.arange(len(F)), indexing="ij"))
    corners = [V[i] for i in F[f].T]
    nearest = np.einsum("fk,fkx->fx", closest_in_triangle(Q[P], *corners), V[F[f]])
    return ((nearest - Q[P]) ** 2).sum(axis=1).reshape(len(Q), len(F))


@needs_numba
@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.sampled_from([0.0, 1e-9, 0.1, 1.0]))
@settings(max_examples=40)
@example(0, 1, 0.0)
@example(0, 2, 1.0)
def test_no_triangle_is_closer(seed, n_faces, flatness):
    """Also among slivers, triangles without area, and those that lie upon each other."""
    rng = np.random.default_rng(seed)
    V = rng.uniform(-0.5, 0.5, size=(12, 3)) * (1.0, 1.0, flatness)
    F = rng.integers(len(V), size=(n_faces, 3))
    Q = np.concatenate([rng.normal(size=(20, 3)), V, V[F].mean(axis=1)])
    face = searching.triangle_search(V, F).closest(Q)
    found = squares(V, F, Q)
    chosen = np.sqrt(found[np.arange(len(Q)), face])
    np.testing.assert_allclose(chosen, np.sqrt(found.min(axis=1)), atol=1e-14)


@needs_numba
def test_of_triangles_about_a_vertex_the_first_counts():
    V, F = icosphere(2)
    first = np.array([np.argmax((F - v == 0).any(axis=1)) for v in range(len(V))])
    # Beside the mesh in one pose, another in which its triangles lie elsewhere.
    other = searching.search_order(V[:, ::-1] * (1.0, 2.0, 3.0), F)
    for order in (None, other):
        np.testing.assert_array_equal(ClosestPoints(V, F, order).faces(V), first)


@needs_numba
def test_what_is_no_number_is_answered_all_the_same():
    V, F = icosphere(1)
    Q = np.array([[np.nan, 0.0, 0.0], [np.inf, 0.0, 0.0], V[5]])
    face = ClosestPoints(V, F).faces(Q)
    assert np.all((face >= 0) & (face < len(F)))
    assert 5 in F[face[2]]


def test_open3d_stands_in_for_the_loops(monkeypatch):
    V, F = icosphere(3)
    Q = 1.1 * icosphere(2)[0]
    with_loops = ClosestPoints(V, F).points(Q)
    monkeypatch.setattr(searching, "load_loops", lambda _: None)
    assert searching.search_order(V, F) is None
    np.testing.assert_allclose(ClosestPoints(V, F).points(Q), with_loops, atol=1e-6)
