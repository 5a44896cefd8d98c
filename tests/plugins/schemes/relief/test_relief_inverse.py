"""Smoothing fine meshes on a coarse one: nearly the same, and still symmetric."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.mesh.geometry import vertex_areas
from meshmark.testing.meshes import icosphere, side_by_side, torus
from meshmark_plugins.schemes.relief import inverse
from meshmark_plugins.schemes.relief.basis import Level, Smoother
from meshmark_plugins.schemes.relief.inverse import coarse_space
from meshmark_plugins.schemes.relief.noise import SmoothNoise

V, F = side_by_side(torus(120, 60), (icosphere(2)[0] + (3.0, 0.0, 0.0), icosphere(2)[1]))
PATCHES = 300


@pytest.fixture
def space(monkeypatch):
    monkeypatch.setattr(inverse, "MOST_VERTICES", 5_000)
    monkeypatch.setattr(inverse, "COARSE_VERTICES", 2_000)
    return coarse_space(V, F)


def test_only_fine_meshes_have_a_coarse_space(space) -> None:
    few, _ = icosphere(3)
    assert coarse_space(*icosphere(3)) is None
    assert len(few) < space.shape[1] < len(V) / 3
    np.testing.assert_allclose(space.sum(axis=1), 1.0, atol=1e-12)
    # The ball is small: its vertices stand for themselves.
    ball = space[-len(icosphere(2)[0]) :]
    assert ball.nnz == ball.shape[0]


def test_what_is_smooth_is_nearly_the_same(space) -> None:
    area = vertex_areas(V, F)
    exact, coarse = Level(V, F, PATCHES), Level(V, F, PATCHES, space)
    np.testing.assert_array_equal(exact.label, coarse.label)
    w = np.random.default_rng(0).choice((-1.0, 1.0), (exact.n_chips, 8))
    one, other = exact.heights(w), coarse.heights(w)
    alike = area @ (one * other) / np.sqrt((area @ one**2) * (area @ other**2))
    assert alike.min() > 0.995
    # A constant is kept exactly, as it is by smoothing on the mesh itself.
    smoother = Smoother(V, F, 0.2, space)
    np.testing.assert_allclose(smoother(np.ones(len(V))), 1.0, atol=1e-9)


def test_the_adjoint_is_the_transpose(space) -> None:
    rng = np.random.default_rng(1)
    level = Level(V, F, PATCHES, space)
    w, x = rng.normal(size=(level.n_chips, 3)), rng.normal(size=(len(V), 3))
    np.testing.assert_allclose(level.heights(w).T @ x, w.T @ level.adjoint(x), atol=1e-10)
    precision = SmoothNoise(level.smoother).precision
    y = rng.normal(size=(len(V), 3))
    np.testing.assert_allclose(x.T @ precision(y), precision(x).T @ y, rtol=1e-9)
    assert np.all(np.diag(x.T @ precision(x)) > 0.0)
