"""Shape diameters: where they are known, and that nothing but the shape decides them."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.mesh.topology import face_adjacency
from meshmark.testing.invariance import moved, reordered
from meshmark.testing.meshes import cylinder, icosphere, plane, side_by_side
from meshmark.testing.segmenters import lopsided
from meshmark_plugins.segmenters.sdf import shape_diameter
from meshmark_plugins.segmenters.sdf.diameter import cone

# Rays


@pytest.mark.parametrize(("wanted", "got"), [(1, 1), (2, 7), (7, 7), (25, 25), (26, 31)])
def test_cone_has_an_axis_and_whole_rings(wanted, got):
    angle, azimuth = cone(120.0, wanted)
    assert len(angle) == len(azimuth) == got
    assert angle[0] == 0.0
    assert np.all(angle < np.pi / 3)


def test_cone_is_even_in_solid_angle():
    angle, _ = cone(120.0, 601)
    # Within any smaller cone there are as many rays as its share of the spherical cap.
    for part in (20.0, 40.0, 60.0, 90.0):
        share = (1.0 - np.cos(np.radians(part / 2.0))) / (1.0 - np.cos(np.pi / 3.0))
        assert np.mean(angle < np.radians(part / 2.0)) == pytest.approx(share, abs=0.01)


# Diameters


def test_diameter_along_the_axis_of_a_sphere():
    V, F = icosphere(4, radius=3.0)
    np.testing.assert_allclose(shape_diameter(V, F, rays=1), 6.0, rtol=3e-3)


def test_diameter_of_a_sphere_is_the_mean_of_its_chords():
    V, F = icosphere(4)
    diameter = shape_diameter(V, F, cone_angle=60.0, rays=25)
    angle, _ = cone(60.0, 25)
    # A chord at angle a from the inward normal has length 2 cos a.
    chord = 2.0 * np.cos(angle)
    near = np.abs(chord - np.median(chord)) <= np.std(chord)
    weight = 1.0 / np.maximum(angle, angle[1] / 2.0)
    np.testing.assert_allclose(diameter, np.average(chord[near], weights=weight[near]), rtol=5e-3)


def test_diameter_along_the_axis_of_a_cylinder():
    V, F = cylinder(64, 40, radius=0.5, height=10.0)
    diameter = shape_diameter(V, F, rays=1)
    centroid = V[F].mean(axis=1)
    side = np.hypot(centroid[:, 0], centroid[:, 1]) > 0.49
    np.testing.assert_allclose(diameter[side], 1.0, rtol=5e-3)
    np.testing.assert_allclose(diameter[~side & (centroid[:, 2] % 10.0 == 0.0)], 10.0, rtol=1e-4)


def test_diameter_does_not_know_how_long_a_cylinder_is():
    short, long = (
        shape_diameter(*cylinder(48, n, radius=1.0, height=h)) for n, h in ((41, 20.0), (81, 40.0))
    )
    middle = [d[len(d) // 2 - 48 : len(d) // 2 + 48] for d in (short, long)]
    np.testing.assert_allclose(middle[0].mean(), middle[1].mean(), rtol=0.01)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_diameter_scales_and_turns_with_the_mesh(scale):
    V, F = lopsided()
    diameter = shape_diameter(V, F)
    again = shape_diameter(moved(V, scale, np.random.default_rng(0)), F) / scale
    # A ray that grazes an edge may fall to either side of it.
    assert np.quantile(np.abs(again - diameter), 0.99) < 1e-4
    assert np.abs(again - diameter).mean() < 1e-3


def test_diameter_does_not_depend_on_order():
    V, F = lopsided()
    other = reordered(V, F, np.random.default_rng(5))
    difference = np.abs(shape_diameter(other.V, other.F) - shape_diameter(V, F)[other.face])
    assert np.quantile(difference, 0.99) < 1e-4


def test_diameter_of_a_mesh_that_is_inside_out():
    V, F = lopsided()
    # Corners reversed, the faces' frames are mirrored: the rays are others of the same cone.
    np.testing.assert_allclose(
        shape_diameter(V, F[:, ::-1]).mean(), shape_diameter(V, F).mean(), rtol=0.01
    )


def test_diameter_of_faces_without_area_is_their_neighbours():
    V, F = cylinder(32, 20)
    squashed = V.copy()
    flat = 300
    squashed[F[flat, 1]] = squashed[F[flat, 0]]
    diameter = shape_diameter(squashed, F)
    assert np.all(np.isfinite(diameter))
    pairs, _ = face_adjacency(F)
    beside = pairs[(pairs == flat).any(axis=1)]
    around = diameter[beside[beside != flat]]
    assert around.min() - 1e-9 <= diameter[flat] <= around.max() + 1e-9


def test_diameter_is_nan_only_where_a_whole_component_has_none():
    V, F = side_by_side(icosphere(2), (plane(4)[0] + 7.0, plane(4)[1]))
    diameter = shape_diameter(V, F)
    np.testing.assert_array_equal(np.isnan(diameter), np.arange(len(F)) >= 320)


def test_diameter_looks_past_nothing_at_inner_faces():
    # A ball inside a ball, both facing outwards: the inner skin is no far side.
    V, F = side_by_side(icosphere(3), icosphere(2, radius=0.3))
    diameter = shape_diameter(V, F)
    outer = diameter[: 20 * 4**3]
    assert np.all(outer > 0.6)
    assert np.all(diameter[20 * 4**3 :] < 0.6)
