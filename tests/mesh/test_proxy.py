"""Proxies: coarse meshes of the same surface, which the fine one hangs on."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from meshmark.mesh.geometry import face_areas, lengths
from meshmark.mesh.proxy import _dual_triangles, build_proxy
from meshmark.mesh.topology import boundary_edges, edges
from meshmark.testing.meshes import bent_tube, bumpy_sphere, capsule, icosphere, plane, torus

HORNS = np.array([[1, 0.2, 0.1], [-0.3, 1, 0.2], [-0.6, -0.7, 0.5]])
SAMPLES = 600
SURFACES = {
    "sphere": icosphere(4),
    "torus": torus(72, 30),
    "horns": bumpy_sphere(4, HORNS),
    "tube": capsule(24, 100, radius=0.1),
    "square": plane(45),
}


def euler_characteristic(F):
    return len(np.unique(F)) - len(edges(F)) + len(F)


def border_length(V, F):
    rim = boundary_edges(F)
    return lengths(V[rim[:, 0]] - V[rim[:, 1]]).sum()


def spacing(V, F, proxy):
    """Mean distance between samples."""
    return np.sqrt(face_areas(V, F).sum() / len(proxy.samples))


@pytest.fixture(scope="module", params=SURFACES)
def surface(request):
    V, F = SURFACES[request.param]
    return V, F, build_proxy(V, F, SAMPLES)


def test_a_proxy_is_the_same_surface_with_fewer_vertices(surface):
    V, F, proxy = surface
    assert len(proxy.samples) == pytest.approx(SAMPLES, rel=0.1)
    assert euler_characteristic(proxy.faces) == euler_characteristic(F)
    # Turned alike: no side of a triangle is walked along twice the same way.
    f = proxy.faces
    sides = np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]])
    assert len(np.unique(sides, axis=0)) == len(sides)
    X = proxy.fit(V)
    assert face_areas(X, f).sum() == pytest.approx(face_areas(V, F).sum(), rel=0.02)
    assert border_length(X, f) == pytest.approx(border_length(V, F), rel=0.01)
    normals = np.cross(X[f[:, 1]] - X[f[:, 0]], X[f[:, 2]] - X[f[:, 0]])
    fine = np.cross(V[F[:, 1]] - V[F[:, 0]], V[F[:, 2]] - V[F[:, 0]])
    volume, fine_volume = np.vecdot(X[f[:, 0]], normals).sum(), np.vecdot(V[F[:, 0]], fine).sum()
    assert volume == pytest.approx(fine_volume, rel=0.03, abs=1e-9)


def test_every_vertex_lies_in_a_triangle_near_it(surface):
    V, F, proxy = surface
    P = proxy.prolongation
    assert P.data.min() >= 0.0
    np.testing.assert_allclose(P.sum(axis=1), 1.0)
    corners = P.indices.reshape(-1, 3)
    triangles = {tuple(sorted(face)) for face in proxy.faces.tolist()}
    assert {tuple(sorted(row)) for row in corners.tolist()} <= triangles
    gap = lengths(P @ proxy.fit(V) - V)
    assert gap.max() < 0.6 * spacing(V, F, proxy)
    np.testing.assert_allclose(P[proxy.samples].toarray(), np.eye(len(proxy.samples)), atol=1e-12)


def test_the_border_s_samples_are_on_the_border():
    V, F = SURFACES["square"]
    proxy = build_proxy(V, F, SAMPLES)
    rim = proxy.samples[np.unique(boundary_edges(proxy.faces))]
    assert np.isin(rim, boundary_edges(F)).all()


def test_fitting_gives_back_what_was_prolonged(surface):
    V, _, proxy = surface
    X = np.random.default_rng(3).normal(size=(len(proxy.samples), 3))
    np.testing.assert_allclose(proxy.fit(proxy.prolong(X.T).T), X, atol=1e-9)
    # And moves with what it is fitted to.
    turn = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    shift = np.array([3.0, -1.0, 2.0])
    np.testing.assert_allclose(proxy.fit(V @ turn + shift), proxy.fit(V) @ turn + shift, atol=1e-9)


def test_fitting_takes_noise_away():
    V, F = icosphere(5)
    proxy = build_proxy(V, F, SAMPLES)
    rng = np.random.default_rng(5)
    noisy = V + rng.normal(scale=0.01, size=V.shape)
    change = lengths(proxy.fit(noisy) - proxy.fit(V))
    assert np.sqrt((change**2).mean()) < 0.5 * 0.01 * np.sqrt(3.0)


def test_a_proxy_built_in_one_pose_is_one_in_another():
    V, F = bent_tube(30, 80, angle=0.0)
    bent, _ = bent_tube(30, 80, angle=np.pi)
    proxy = build_proxy(V, F, SAMPLES)
    gap = lengths(proxy.prolongation @ proxy.fit(bent) - bent)
    assert gap.max() < 0.6 * spacing(V, F, proxy)
    area = face_areas(proxy.fit(bent), proxy.faces).sum()
    assert area == pytest.approx(face_areas(bent, F).sum(), rel=0.01)


def test_a_needle_is_too_thin_for_a_proxy():
    V, F = capsule(12, 300, radius=0.002)
    assert build_proxy(V, F, 600) is None
    # The same triangles on a thicker tube are not.
    V, F = capsule(12, 300, radius=0.1)
    assert build_proxy(V, F, 600) is not None


@pytest.mark.parametrize("scale", [0.0, 1e200])
def test_a_surface_whose_area_is_no_number_has_no_proxy(scale):
    V, F = plane(24)
    with np.errstate(all="ignore"):
        assert build_proxy(scale * V, F, 100) is None


def test_three_sheets_that_share_an_edge_stay_joined():
    V, F = plane(24)
    rows = np.arange(576).reshape(24, 24)
    # Sheets in the planes y = 0, z = 0 and y = -z, joined along the x axis.
    sheets = [V, V[:, [0, 2, 1]], np.stack([V[:, 0], -V[:, 1], V[:, 1]], axis=1)]
    book = [F]
    for k in (1, 2):
        number = np.arange(576) + 576 * k
        number[rows[0]] = rows[0]
        book.append(number[F])
    V, F = np.concatenate(sheets), np.concatenate(book)
    used, F = np.unique(F, return_inverse=True)
    V, F = V[used], F.reshape(-1, 3)
    proxy = build_proxy(V, F, 600)
    assert lengths(proxy.prolongation @ proxy.fit(V) - V).max() < 0.6 * spacing(V, F, proxy)
    assert face_areas(proxy.fit(V), proxy.faces).sum() == pytest.approx(
        2.0 + np.sqrt(2.0), rel=0.01
    )


def test_triangles_that_meet_the_same_samples_from_both_sides_cancel():
    nearest = np.array([0, 1, 2, 0, 1, 2, 3])
    once, turned = [0, 1, 2], [3, 5, 4]
    assert _dual_triangles(nearest, np.array([once])).tolist() == [[0, 1, 2]]
    assert _dual_triangles(nearest, np.array([[5, 4, 3]])).tolist() == [[0, 2, 1]]
    assert _dual_triangles(nearest, np.array([once, turned, [0, 1, 6]])).tolist() == [[0, 1, 3]]
    # Corners nearest to one or two samples make none.
    assert _dual_triangles(nearest, np.array([[0, 3, 1]])).tolist() == []


def test_a_proxy_is_the_same_every_time_and_survives_pickling(surface):
    V, F, proxy = surface
    again = pickle.loads(pickle.dumps(build_proxy(V, F, SAMPLES)))
    np.testing.assert_array_equal(again.samples, proxy.samples)
    np.testing.assert_array_equal(again.faces, proxy.faces)
    np.testing.assert_array_equal(again.fit(V), proxy.fit(V))
