"""The tips of shapes whose tips are known, and the survey of a frame."""

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
from meshmark_plugins.schemes.apex.anchors.components import split
from meshmark_plugins.schemes.apex.anchors.detect import VICINITY, measure_from, survey
from meshmark_plugins.schemes.apex.anchors.geodesics import RadialDistances
from meshmark_plugins.schemes.apex.anchors.integral_distance import (
    centre_of_caps,
    distance_to_border,
    find_anchors,
    integral_distance,
)
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
    radial = RadialDistances(V, F)
    return V[find_anchors(V, F, radial, least, 12).vertices] / radial.root_area, radial.root_area


def assert_same_places(found, wanted, atol):
    """Each place is found, and nothing else."""
    assert len(found) == len(wanted)
    gaps = np.linalg.norm(found[:, None] - wanted[None], axis=2)
    assert gaps.min(axis=0).max() < atol
    assert gaps.min(axis=1).max() < atol


def test_no_vertex_of_a_sphere_is_nearer_to_the_rest_than_others():
    V, F = icosphere(4)
    f = integral_distance(V, F, RadialDistances(V, F))
    np.testing.assert_allclose(f, np.pi / 2.0 * UNIT, rtol=0.005)


def test_ends_of_a_thin_capsule_are_half_its_length_from_the_rest_its_middle_a_quarter():
    radius, length = 0.1, 4.0
    V, F = capsule(48, 200, radius, length)
    radial = RadialDistances(V, F)
    f = integral_distance(V, F, radial) * radial.root_area / (length + np.pi * radius)
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
    radial = RadialDistances(V, F)
    found = find_anchors(V, F, radial, LEAST, 12)
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
    found = V[centre_of_caps(V, F, f, maxima)]
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
    radial = RadialDistances(V, F)
    every = find_anchors(V, F, radial, LEAST, 12)
    few = find_anchors(V, F, radial, LEAST, 2)
    assert len(every.vertices) == 6
    np.testing.assert_array_equal(few.vertices, every.vertices[:2])
    # The tall ones.
    assert np.all(np.linalg.norm(V[few.vertices], axis=1) > 2.5)
    assert np.all(every.persistence[:-1] >= every.persistence[1:])


def test_nothing_stands_out_of_a_sphere_and_the_error_says_what_a_mark_needs():
    V, F = icosphere(4)
    assert find_anchors(V, F, RadialDistances(V, F), 0.01, 12).vertices.size == 0
    with pytest.raises(CapacityError, match="tips such as hands, feet"):
        survey(V, F, LEAST, 12)


def test_distance_to_a_border_is_straight_and_none_is_far_away():
    V, F = plane(21, side=2.0)
    middle, corner, beside = 220, 0, 23
    np.testing.assert_allclose(
        distance_to_border(V, F, np.array([middle, corner, beside])), [1.0, 0.0, 0.1]
    )
    assert np.all(np.isinf(distance_to_border(*icosphere(1), np.arange(3))))


# The survey.


def two_capsules_and_a_button():
    large, (V, F) = capsule(24, 60), capsule(20, 50, 0.2, 2.0)
    button = icosphere(1, 0.1)
    shift = np.array([3.0, 0, 0])
    return side_by_side(large, (V + shift, F), (button[0] + 2 * shift, button[1]))


def test_every_piece_has_its_own_tips_and_unit_and_buttons_have_none():
    V, F = two_capsules_and_a_button()
    assert [len(piece.vertices) for piece in split(V, F)] == [1442, 1002]
    nears = survey(V, F, LEAST, 12)
    assert [sorted(near.anchors.tolist()) for near in nears] == [[1440, 1441], [2442, 2443]]
    for near, (V, F) in zip(nears, [capsule(24, 60), capsule(20, 50, 0.2, 2.0)], strict=True):
        assert near.unit == pytest.approx(np.sqrt(face_areas(V, F).sum()))
        assert near.H.shape == (2, len(V))


def test_over_all_pieces_the_most_prominent_are_kept():
    V, F = two_capsules_and_a_button()
    every = np.concatenate([near.persistence for near in survey(V, F, LEAST, 12)])
    (near,) = survey(V, F, LEAST, 1)
    assert near.persistence.tolist() == [every.max()]


@pytest.mark.parametrize("most", [1, 2, 3])
def test_of_equals_no_more_are_kept_than_asked_for(most):
    one = capsule(24, 60)
    twin = one[0] + [3.0, 0.0, 0.0], one[1]
    V, F = side_by_side(one, twin)
    kept = np.concatenate([near.anchors for near in survey(V, F, LEAST, most)])
    assert len(kept) == most


def test_measuring_from_given_anchors_finds_the_same_distances():
    V, F = two_capsules_and_a_button()
    given = measure_from(V, F, np.array([2443, 1440, 2442]))
    assert [near.anchors.tolist() for near in given] == [[1440], [2443, 2442]]
    for near, seen in zip(given, survey(V, F, LEAST, 12), strict=True):
        row = {int(vertex): H for vertex, H in zip(seen.anchors, seen.H, strict=True)}
        np.testing.assert_array_equal(near.H, [row[int(vertex)] for vertex in near.anchors])
        assert not near.persistence.any()
    with pytest.raises(CapacityError, match="too small"):
        measure_from(V, F, np.array([1440, len(V) - 1]))


def test_bulk_and_remoteness_of_a_point_of_a_sphere():
    V, F = icosphere(5)
    (near,) = measure_from(V, F, np.array([0, 100]))
    # Archimedes: the share of a cap is half its height.
    np.testing.assert_allclose(near.bulk, (1.0 - np.cos(VICINITY / UNIT)) / 2.0, rtol=0.015)
    np.testing.assert_allclose(near.remoteness, np.pi / 2.0 * UNIT, rtol=0.005)


def assert_same_survey(other, vertex, near):
    np.testing.assert_array_equal(vertex[other.anchors], near.anchors)
    np.testing.assert_allclose(other.persistence, near.persistence, rtol=0, atol=1e-9)
    np.testing.assert_allclose(other.H, near.H[:, vertex], rtol=0, atol=1e-9)
    np.testing.assert_allclose(other.bulk, near.bulk, rtol=0, atol=1e-9)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_a_similarity_changes_nothing(scale):
    V, F = bumpy_sphere(4, HORNS)
    (other,) = survey(moved(V, scale, np.random.default_rng(2)), F, LEAST, 12)
    assert_same_survey(other, np.arange(len(V)), *survey(V, F, LEAST, 12))


def test_the_order_of_vertices_and_faces_changes_nothing():
    V, F = bumpy_sphere(4, HORNS)
    mixed = reordered(V, F, np.random.default_rng(3))
    (other,) = survey(mixed.V, mixed.F, LEAST, 12)
    assert_same_survey(other, mixed.vertex, *survey(V, F, LEAST, 12))


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_a_sighting_is_the_same_wherever_and_however_large_and_in_any_order(scale):
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
