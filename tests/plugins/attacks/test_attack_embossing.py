from __future__ import annotations

import numpy as np
import pytest

from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.geometry import vertex_areas, vertex_normals
from meshmark.mesh.topology import Topology, edges
from meshmark.testing.attacks import AttackSuite, bending_ball, sphere
from meshmark.testing.meshes import plane, torus
from meshmark_plugins.attacks import RECORDS

RECORD = {record.name: record for record in RECORDS}["embossing"]


class TestEmbossing(AttackSuite):
    @pytest.fixture
    def record(self):
        return RECORD


class TestEmbossingOfChangingMeshes(TestEmbossing):
    @pytest.fixture
    def animation(self):
        return MeshAnimation.from_frames(
            [
                Frame(float(n), V, Topology.from_triangles(F, n))
                for n in (300, 400)
                for V, F in [sphere(n)]
            ]
        )


def embossed(animation, seed=0, **parameters):
    return RECORD.factory(**parameters).apply(animation, np.random.default_rng(seed))


def displacement(V, F, seed=0, **parameters):
    return embossed(MeshAnimation.from_arrays(V, F), seed, **parameters)[0].points - V


def rms(D, V, F):
    area = vertex_areas(V, F)
    return np.sqrt(area @ np.sum(D**2, axis=1) / area.sum())


@pytest.mark.parametrize("height", [1e-4, 3e-4, 1e-3])
@pytest.mark.parametrize("patches", [400, 1600])
@pytest.mark.parametrize(
    ("mesh", "diagonal"),
    [
        (lambda: torus(120, 60, 1.0, 0.4), np.sqrt(2 * 2.8**2 + 0.8**2)),
        (lambda: plane(80), np.sqrt(2.0)),
    ],
)
def test_heights_are_as_large_as_asked_for_and_along_the_normals(mesh, diagonal, height, patches):
    V, F = mesh()
    D = displacement(V, F, height=height, patches=patches)
    assert rms(D, V, F) == pytest.approx(height * diagonal, rel=0.01)
    n = vertex_normals(V, F)
    along = np.einsum("ij,ij->i", D, n)
    np.testing.assert_allclose(D, along[:, None] * n, atol=1e-12)
    assert along.min() < -0.5 * height < 0.5 * height < along.max()


@pytest.mark.parametrize("patches", [25, 100, 400])
def test_bumps_are_as_wide_as_patches(patches):
    # A field of Gaussian bumps has the autocorrelation exp(-r^2 / 4 s^2), so its slope is h / s.
    V, F = plane(160)
    slopes = []
    for seed in range(20):
        h = displacement(V, F, seed, patches=patches)[:, 2].reshape(160, 160)
        # Away from the border, where half of the bumps are missing.
        inner = h[40:120, 40:120]
        slope = np.array(np.gradient(inner, 1 / 159))[:, 1:-1, 1:-1]
        slopes.append(np.sqrt(np.mean(slope**2, axis=(1, 2)).sum() / np.mean(inner**2)))
    s = np.sqrt(1.0 / patches) / 2
    assert np.median(slopes) == pytest.approx(1 / s, rel=0.15)


def test_heights_rest_on_the_moving_surface():
    ball = bending_ball()
    found = []
    for before, after in zip(ball, embossed(ball), strict=True):
        n = vertex_normals(before.points, before.faces)
        found.append(np.einsum("ij,ij->i", after.points - before.points, n))
        np.testing.assert_allclose(after.points - before.points, found[-1][:, None] * n, atol=1e-12)
    assert np.abs(found[0]).max() > 1e-4
    np.testing.assert_allclose(found, np.broadcast_to(found[0], np.shape(found)), atol=1e-12)


def test_a_cut_surface_stays_closed():
    V, F = sphere(600)
    apart = V[F.ravel()]
    D = displacement(apart, np.arange(F.size).reshape(-1, 3), height=1e-3)
    whole = displacement(V, F, height=1e-3)
    np.testing.assert_allclose(D, whole[F.ravel()], atol=1e-12)


def test_other_numbers_make_another_relief():
    V, F = sphere(2000)
    one, two = (np.einsum("ij,ij->i", displacement(V, F, seed), V) for seed in (1, 2))
    assert abs(np.corrcoef(one, two)[0, 1]) < 0.3


def test_it_is_smooth_between_neighbours():
    V, F = sphere(4000)
    h = np.einsum("ij,ij->i", displacement(V, F, patches=100), V)
    i, j = edges(F).T
    assert np.corrcoef(h[i], h[j])[0, 1] > 0.9


def test_a_mesh_without_area_stays():
    V = np.ones((3, 3))
    assert not displacement(V, np.array([[0, 1, 2]])).any()
