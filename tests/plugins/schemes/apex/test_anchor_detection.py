"""Anchors of shapes whose tips are known, and distances from them."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.errors import CapacityError
from meshmark.mesh.animation import Frame
from meshmark.mesh.geometry import face_areas
from meshmark.mesh.topology import Topology
from meshmark.testing.invariance import moved, reordered
from meshmark.testing.meshes import (
    bent_tube,
    bumpy_sphere,
    capsule,
    dumbbell,
    icosphere,
    plane,
    side_by_side,
)
from meshmark_plugins.schemes.apex.anchors.components import large_components
from meshmark_plugins.schemes.apex.anchors.detect import (
    cap_centres,
    detect_anchors,
    distance_to_border,
    surface_anchors,
)
from meshmark_plugins.schemes.apex.anchors.geodesic_field import DISC_RADIUS, geodesic_fields
from meshmark_plugins.schemes.apex.anchors.geodesics import GeodesicDistances
from meshmark_plugins.schemes.apex.anchors.integral_distance import integral_distance
from meshmark_plugins.schemes.apex.anchors.persistence import persistent_maxima
from meshmark_plugins.schemes.apex.scheme import Apex

LEAST = 0.06
HORNS = np.array(
    [[1, 0.2, 0.1], [-0.3, 1, 0.2], [-0.6, -0.7, 0.5], [0.2, -0.5, -1], [-0.5, 0.3, -0.9]]
)
# Radius of a sphere of area 1.
UNIT = 1.0 / np.sqrt(4.0 * np.pi)


def anchors(V, F, least=LEAST):
    """Positions of the anchors in root areas, and the root area."""
    geodesics = GeodesicDistances(V, F)
    return V[
        surface_anchors(V, F, geodesics, least, 12).vertices
    ] / geodesics.root_area, geodesics.root_area


def detected(V, F, min_persistence, max_anchors):
    """Detect anchors, and measure distances from them."""
    found = detect_anchors(V, F, min_persistence, max_anchors)
    return [anchors.geodesic_field() for anchors in found]


def assert_same_places(found, wanted, atol):
    """Each place is found, and nothing else."""
    assert len(found) == len(wanted)
    gaps = np.linalg.norm(found[:, None] - wanted[None], axis=2)
    assert gaps.min(axis=0).max() < atol
    assert gaps.min(axis=1).max() < atol


def test_no_vertex_of_a_sphere_is_nearer_to_the_rest_than_others():
    V, F = icosphere(4)
    f = integral_distance(V, F, GeodesicDistances(V, F))
    np.testing.assert_allclose(f, np.pi / 2.0 * UNIT, rtol=0.005)


def test_ends_of_a_thin_capsule_are_half_its_length_from_the_rest_its_middle_a_quarter():
    radius, length = 0.1, 4.0
    V, F = capsule(48, 200, radius, length)
    geodesics = GeodesicDistances(V, F)
    f = integral_distance(V, F, geodesics) * geodesics.root_area / (length + np.pi * radius)
    np.testing.assert_allclose(f[-2:], 0.5, atol=0.015)
    assert f.min() == pytest.approx(0.25, abs=0.015)
    assert np.abs(V[np.argmin(f), 2]) < 0.05 * length


def test_tips_of_a_capsule():
    V, F = capsule(24, 80)
    found, root_area = anchors(V, F)
    assert_same_places(found, V[-2:] / root_area, 0.01)


def test_tips_of_a_dumbbell_stand_on_the_far_sides():
    V, F = dumbbell()
    found, root_area = anchors(V, F)
    assert_same_places(found, V[-2:] / root_area, 0.03)


@pytest.mark.parametrize("angle", [0.0, np.pi / 2, np.pi])
def test_the_middle_of_a_tube_s_flat_ends_stays_its_tip_as_it_bends(angle):
    # Which point of an end is the farthest from the rest, the bend decides.
    V, F = bent_tube(24, 80, angle=angle)
    geodesics = GeodesicDistances(V, F)
    found = surface_anchors(V, F, geodesics, LEAST, 12)
    assert sorted(found.vertices.tolist()) == [len(V) - 2, len(V) - 1]


def test_the_middle_of_a_cap_is_found_within_its_own_slope():
    V, F = plane(41)
    # Two flat hilltops that tilt: the maximum is at their rim.
    hills = [np.hypot(*(V[:, :2] - centre).T) for centre in ([0.3, 0.3], [0.7, 0.7])]
    f = np.maximum.reduce([np.maximum(0.0, 1.0 - 5.0 * np.maximum(h - 0.15, 0.0)) for h in hills])
    f += 0.02 * V[:, 0]
    maxima = persistent_maxima(f, F, 0.5).vertices
    middles = np.array([[0.7, 0.7, 0.0], [0.3, 0.3, 0.0]])
    assert np.linalg.norm(V[maxima] - middles, axis=1).min() > 0.1
    found = V[cap_centres(V, F, f, maxima)]
    np.testing.assert_allclose(found, middles, atol=0.026)


@pytest.mark.parametrize("count", [3, 4, 5])
def test_tips_of_horns(count):
    V, F = bumpy_sphere(5, HORNS[:count])
    axes = HORNS[:count] / np.linalg.norm(HORNS[:count], axis=1, keepdims=True)
    found, root_area = anchors(V, F)
    # A little aside, away from the other horns.
    assert_same_places(found, 2.5 * axes / root_area, 0.03)


EVEN = {
    "opposite": [[1, 2, 3], [-1, -2, -3]],
    "triangle": [[1, 0, -1], [-1, 1, 0], [0, -1, 1]],
    "tetrahedron": [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]],
    "octahedron": [[1, 1, 0], [-1, -1, 0], [1, -1, 0], [-1, 1, 0], [0, 0, 1], [0, 0, -1]],
}


@pytest.mark.parametrize("axes", EVEN.values(), ids=EVEN)
def test_tips_of_horns_that_stand_evenly_about_are_where_they_are(axes):
    V, F = bumpy_sphere(5, np.array(axes))
    tips = 2.5 * np.array(axes) / np.linalg.norm(axes, axis=1, keepdims=True)
    found, root_area = anchors(V, F)
    assert_same_places(found, tips / root_area, 0.02)


def test_only_the_most_prominent_are_returned():
    V, F = bumpy_sphere(4, np.array(EVEN["octahedron"]), height=np.array([1, 1, 1, 1, 2, 2]))
    geodesics = GeodesicDistances(V, F)
    every = surface_anchors(V, F, geodesics, LEAST, 12)
    few = surface_anchors(V, F, geodesics, LEAST, 2)
    assert len(every.vertices) == 6
    np.testing.assert_array_equal(few.vertices, every.vertices[:2])
    # The tall ones.
    assert np.all(np.linalg.norm(V[few.vertices], axis=1) > 2.5)
    assert np.all(every.persistence[:-1] >= every.persistence[1:])


def test_nothing_stands_out_of_a_sphere_and_the_error_says_what_a_mark_needs():
    V, F = icosphere(4)
    assert surface_anchors(V, F, GeodesicDistances(V, F), 0.01, 12).vertices.size == 0
    with pytest.raises(CapacityError, match="tips such as hands, feet"):
        detected(V, F, LEAST, 12)


def test_distance_to_a_border_is_straight_and_none_is_far_away():
    V, F = plane(21, side=2.0)
    middle, corner, beside = 220, 0, 23
    np.testing.assert_allclose(
        distance_to_border(V, F, np.array([middle, corner, beside])), [1.0, 0.0, 0.1]
    )
    assert np.all(np.isinf(distance_to_border(*icosphere(1), np.arange(3))))


# Distances from them.


def two_capsules_and_a_button():
    large, (V, F) = capsule(24, 60), capsule(20, 50, 0.2, 2.0)
    button = icosphere(1, 0.1)
    shift = np.array([3.0, 0, 0])
    return side_by_side(large, (V + shift, F), (button[0] + 2 * shift, button[1]))


def test_every_component_has_its_own_tips_and_root_area_and_buttons_have_none():
    V, F = two_capsules_and_a_button()
    assert [len(component.vertices) for component in large_components(V, F)] == [1442, 1002]
    fields = detected(V, F, LEAST, 12)
    assert [sorted(field.anchors.tolist()) for field in fields] == [[1440, 1441], [2442, 2443]]
    for field, (V, F) in zip(fields, [capsule(24, 60), capsule(20, 50, 0.2, 2.0)], strict=True):
        assert field.length_scale == pytest.approx(np.sqrt(face_areas(V, F).sum()))
        assert field.H.shape == (2, len(V))


def test_over_all_components_the_most_prominent_are_kept():
    V, F = two_capsules_and_a_button()
    every = np.concatenate([field.persistence for field in detected(V, F, LEAST, 12)])
    (field,) = detected(V, F, LEAST, 1)
    assert field.persistence.tolist() == [every.max()]


@pytest.mark.parametrize("most", [1, 2, 3])
def test_of_equals_no_more_are_kept_than_asked_for(most):
    one = capsule(24, 60)
    twin = one[0] + [3.0, 0.0, 0.0], one[1]
    V, F = side_by_side(one, twin)
    kept = np.concatenate([field.anchors for field in detected(V, F, LEAST, most)])
    assert len(kept) == most


def test_measuring_from_given_anchors_finds_the_same_distances():
    V, F = two_capsules_and_a_button()
    given = geodesic_fields(V, F, np.array([2443, 1440, 2442]))
    assert [field.anchors.tolist() for field in given] == [[1440], [2443, 2442]]
    for field, seen in zip(given, detected(V, F, LEAST, 12), strict=True):
        row = {int(vertex): H for vertex, H in zip(seen.anchors, seen.H, strict=True)}
        np.testing.assert_array_equal(field.H, [row[int(vertex)] for vertex in field.anchors])
        assert not field.persistence.any()
    with pytest.raises(CapacityError, match="too small"):
        geodesic_fields(V, F, np.array([1440, len(V) - 1]))


def test_disc_area_and_mean_distance_of_a_point_of_a_sphere():
    V, F = icosphere(5)
    (field,) = geodesic_fields(V, F, np.array([0, 100]))
    # Archimedes: the share of a cap is half its height.
    np.testing.assert_allclose(
        field.disc_area_share, (1.0 - np.cos(DISC_RADIUS / UNIT)) / 2.0, rtol=0.015
    )
    np.testing.assert_allclose(field.mean_geodesic_distance, np.pi / 2.0 * UNIT, rtol=0.005)


def assert_same_field(other, vertex, field):
    np.testing.assert_array_equal(vertex[other.anchors], field.anchors)
    np.testing.assert_allclose(other.persistence, field.persistence, rtol=0, atol=1e-9)
    np.testing.assert_allclose(other.H, field.H[:, vertex], rtol=0, atol=1e-9)
    np.testing.assert_allclose(other.disc_area_share, field.disc_area_share, rtol=0, atol=1e-9)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_a_similarity_changes_nothing(scale):
    V, F = bumpy_sphere(4, HORNS)
    (other,) = detected(moved(V, scale, np.random.default_rng(2)), F, LEAST, 12)
    assert_same_field(other, np.arange(len(V)), *detected(V, F, LEAST, 12))


def test_the_order_of_vertices_and_faces_changes_nothing():
    V, F = bumpy_sphere(4, HORNS)
    mixed = reordered(V, F, np.random.default_rng(3))
    (other,) = detected(mixed.V, mixed.F, LEAST, 12)
    assert_same_field(other, mixed.vertex, *detected(V, F, LEAST, 12))


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_an_observation_is_the_same_wherever_and_however_large_and_in_any_order(scale):
    V, F = bumpy_sphere(4, HORNS, width=np.array([0.34, 0.26, 0.32, 0.24, 0.3]))
    rng = np.random.default_rng(2)
    mixed = reordered(moved(V, scale, rng), F, rng)
    one, other = (
        Apex().observe(Frame(1.0, P, Topology.from_triangles(G, len(P))))
        for P, G in ((V, F), (mixed.V, mixed.F))
    )
    np.testing.assert_array_equal(mixed.vertex[other.vertices], one.vertices)
    np.testing.assert_allclose(other.soft, one.soft, atol=1e-6)
    np.testing.assert_allclose(other.descriptors, one.descriptors, atol=1e-9)
