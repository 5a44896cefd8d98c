"""Surfaces that go on beyond their borders, where it is known how they would."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.mesh.geometry import area_vectors, face_areas
from meshmark.mesh.topology import boundary_edges
from meshmark.testing.invariance import moved
from meshmark.testing.meshes import bent_tube, capsule, icosphere, plane
from meshmark_plugins.schemes.apex.anchors import geodesics
from meshmark_plugins.schemes.apex.anchors.boundary_extension import STRIP_RINGS, extend_boundary
from meshmark_plugins.schemes.apex.anchors.geodesics import GeodesicDistances

WIDTH = 0.1


def below(V, F, height):
    """What is left of a mesh under a plane, and which of its vertices those are."""
    kept, faces = np.unique(F[(V[F, 2] < height).all(axis=1)], return_inverse=True)
    return V[kept], faces.reshape(-1, 3), kept


def test_a_closed_surface_stays_as_it_is():
    V, F = icosphere(2)
    same = extend_boundary(V, F, WIDTH)
    assert same[0] is V
    assert same[1] is F


def test_a_square_goes_on_in_its_plane():
    V, F = plane(21)
    wide, faces = extend_boundary(V, F, WIDTH)
    border = len(np.unique(boundary_edges(F)))
    assert wide.shape == (len(V) + STRIP_RINGS * border, 3)
    assert faces.shape == (len(F) + 2 * STRIP_RINGS * border, 3)
    np.testing.assert_array_equal(wide[: len(V)], V)
    np.testing.assert_array_equal(faces[: len(F)], F)
    assert np.all(area_vectors(wide, faces)[:, 2] > 0.0)
    np.testing.assert_array_equal(wide[:, 2], 0.0)
    # A frame of that width about the square, its corners aside.
    added = face_areas(wide, faces).sum() - face_areas(V, F).sum()
    assert added == pytest.approx(4 * WIDTH, rel=0.1)
    beyond = np.abs(wide[-border:, :2] - V[:, :2].mean(axis=0)).max(axis=1) - 0.5
    assert np.all(beyond <= WIDTH + 1e-12)
    assert beyond.max() == pytest.approx(WIDTH)
    assert len(boundary_edges(faces)) == len(boundary_edges(F))


def test_borders_shorter_than_asked_for_are_left_alone():
    V, F = plane(21)
    # A hole one cell wide in the middle of a square whose sides are 1 long.
    middle = np.argmin(np.linalg.norm(V[F].mean(axis=1) - V.mean(axis=0), axis=1))
    F = np.delete(F, middle, axis=0)
    outer = 4 * 20
    for shortest, extended in ((0.0, outer + 3), (0.5, outer), (4.5, 0)):
        wide, faces = extend_boundary(V, F, WIDTH, shortest)
        assert len(wide) == len(V) + STRIP_RINGS * extended
        assert len(faces) == len(F) + 2 * STRIP_RINGS * extended


def test_a_tube_goes_on_as_a_tube():
    V, F, _ = below(*capsule(40, 120, radius=0.3), 1.0)
    wide, faces = extend_boundary(V, F, WIDTH)
    new = wide[len(V) :]
    np.testing.assert_allclose(np.linalg.norm(new[:, :2], axis=1), 0.3, atol=3e-3)
    assert np.ptp(new[:, 2]) == pytest.approx(WIDTH * (STRIP_RINGS - 1) / STRIP_RINGS, rel=0.01)
    assert new[:, 2].max() - V[:, 2].max() == pytest.approx(WIDTH, rel=0.01)
    outwards = np.vecdot(area_vectors(wide, faces)[len(F) :, :2], wide[faces[len(F) :, 0], :2])
    assert np.all(outwards > 0.0)


def test_the_teeth_of_a_cut_share_a_direction():
    V, F = bent_tube(60, 160)
    # Straight through a bent tube: the triangles it leaves end now here, now there.
    left = F[(V[F] @ [0.3, 0.2, 1.0] < 1.6).all(axis=1)]
    kept, faces = np.unique(left, return_inverse=True)
    V, F = V[kept], faces.reshape(-1, 3)
    wide, _ = extend_boundary(V, F, WIDTH)
    border = np.unique(boundary_edges(F))
    outwards = (wide[len(V) : len(V) + len(border)] - V[border]) * STRIP_RINGS / WIDTH
    np.testing.assert_allclose(np.linalg.norm(outwards, axis=1), 1.0)
    place = np.searchsorted(border, boundary_edges(F))
    assert np.vecdot(outwards[place[:, 0]], outwards[place[:, 1]]).min() > 0.9


def test_an_extension_turns_and_moves_with_its_surface():
    V, F, _ = below(*capsule(24, 60), 0.5)
    rng = np.random.default_rng(0)
    for scale in (1.0, 7.0):
        other = moved(np.concatenate([V, extend_boundary(V, F, WIDTH)[0]]), scale, rng)
        own, _ = extend_boundary(other[: len(V)], F, WIDTH * scale)
        np.testing.assert_allclose(own, other[len(V) :], atol=1e-9 * scale)


def test_distances_beside_a_cut_are_nearly_those_on_the_whole(monkeypatch):
    V, F, _ = below(*icosphere(5), 0.5)
    source = int(np.argmax(V[:, 0]))
    arcs = np.arccos(np.clip(V @ V[source], -1.0, 1.0))
    # Within a third of the radius of the cut, and with a way that does not lead through it.
    beside = (V[:, 2] > 0.2) & (V[:, 0] > 0.0)
    root_area = GeodesicDistances(V, F).root_area

    def errors():
        found = GeodesicDistances(V, F).from_vertex(source)
        assert found.shape == (len(V),)
        return np.abs(found * root_area - arcs)[beside]

    extended = errors()
    monkeypatch.setattr(geodesics, "extend_boundary", lambda V, F, *widths: (V, F))
    assert extended.mean() < 0.5 * errors().mean()
    assert extended.max() < 0.5 * errors().max()
