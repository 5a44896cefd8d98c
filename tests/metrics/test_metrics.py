from __future__ import annotations

import math
import pickle
from dataclasses import asdict

import numpy as np
import pytest

from meshmark.errors import InputError, UsageError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.topology import Topology
from meshmark.metrics import (
    distortion,
    flipped_faces,
    hausdorff,
    max_move_edges,
    min_angle_change,
    mrms,
    normal_turn,
    surface_distance,
)
from meshmark.metrics.summary import ratio_to_all, standard_error
from meshmark.testing.attacks import bending_ball, sphere
from meshmark.testing.meshes import icosphere


def plane(n: int, size: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Triangulate a square of n by n cells in the plane z = 0."""
    x, y = np.meshgrid(np.linspace(0, size, n + 1), np.linspace(0, size, n + 1), indexing="ij")
    V = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    k = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = (q.ravel() for q in (k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]))
    return V, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def up(z: float) -> np.ndarray:
    return np.array([0.0, 0.0, z])


def test_parallel_planes_are_their_distance_apart():
    V, F = plane(8)
    result = surface_distance(V, F, V + up(0.25), F)
    assert result.hausdorff == pytest.approx(0.25, abs=1e-7)
    assert result.mrms == pytest.approx(0.25, abs=1e-7)
    assert result.diagonal == pytest.approx(math.sqrt(2))


def test_tilted_plane_has_the_mean_square_of_its_heights():
    # z = h x over a flat unit square: going back down costs h x cos(atan h), largest h cos(atan h)
    # where the foot still lies inside; h small makes both directions agree with h x.
    V, F = plane(4)
    h = 1e-3
    W = V.copy()
    W[:, 2] = h * V[:, 0]
    result = surface_distance(V, F, W, F, samples=40_000)
    assert result.hausdorff == pytest.approx(h, rel=1e-3)
    assert result.mrms == pytest.approx(h / math.sqrt(3), rel=5e-3)


def test_the_error_of_the_mean_square_covers_how_samples_scatter():
    V, F = plane(4)
    W = V.copy()
    W[:, 2] = 1e-3 * V[:, 0] ** 2
    found = [surface_distance(V, F, W, F, samples=200, seed=seed) for seed in range(40)]
    scatter = np.std([each.mrms for each in found])
    assert 0.0 < scatter < np.mean([each.mrms_error for each in found])
    # Samples that are spread over the surface scatter less than those drawn independently.
    assert found[0].mrms_error < 0.1 * found[0].mrms


def test_concentric_spheres_are_the_difference_of_radii_apart():
    V, F = sphere(6000)
    W, G = sphere(4000)
    result = surface_distance(V, F, 1.1 * W, G)
    sagitta = 2e-3
    assert result.hausdorff == pytest.approx(0.1, abs=sagitta)
    assert result.mrms == pytest.approx(0.1, abs=sagitta)


def test_one_sided_excess_is_seen_from_both_sides():
    # A square and its half: every point of the half is on the square, but not the other way.
    V, F = plane(2)
    W = V * [0.5, 1, 1]
    for pair in [(V, F, W, F), (W, F, V, F)]:
        assert hausdorff(*pair) == pytest.approx(0.5, abs=1e-12)
        # Half of the area is at distance 0, the rest uniformly in [0, 1/2].
        assert mrms(*pair) == pytest.approx(math.sqrt(0.5 * 0.25 / 3), rel=0.01)


def test_sliding_within_the_surface_costs_nothing():
    V, F = plane(20)
    W = V.copy()
    inner = (V > 0).all(axis=1, where=[True, True, False])
    inner &= (V < 1).all(axis=1, where=[True, True, False])
    W[inner, :2] += np.random.default_rng(0).uniform(-0.01, 0.01, (inner.sum(), 2))
    assert hausdorff(V, F, W, F) < 1e-8


@pytest.mark.parametrize("offset", [0.0, 1e4])
def test_identical_meshes_show_no_distance(offset):
    V, F = sphere(3000)
    V = V + offset
    result = surface_distance(V, F, V.copy(), F.copy())
    assert result.hausdorff < 1e-7 * result.diagonal
    assert result.mrms < 1e-9 * result.diagonal


@pytest.mark.parametrize("offset", [0.0, 100.0])
def test_tiny_distances_survive_single_precision(offset):
    V, F = plane(30)
    shift = 1e-6
    result = surface_distance(V + offset, F, V + offset + up(shift), F)
    assert result.mrms == pytest.approx(shift, rel=1e-5)


def test_distances_scale_and_are_the_same_for_any_order_of_faces():
    V, F = sphere(500)
    W = V * [1, 1.05, 1]
    one = surface_distance(V, F, W, F)
    two = surface_distance(7 * V, F, 7 * W, F)
    assert two.hausdorff == pytest.approx(7 * one.hausdorff)
    assert two.mrms == pytest.approx(7 * one.mrms)
    three = surface_distance(V, F[::-1], W, F)
    assert three.mrms == pytest.approx(one.mrms, rel=0.01)


def test_a_mesh_without_extent_cannot_be_compared():
    V, F = sphere(50)
    with pytest.raises(InputError, match="without extent"):
        surface_distance(np.zeros((3, 3)), np.array([[0, 1, 2]]), V, F)
    with pytest.raises(InputError, match="without faces"):
        surface_distance(V, F, V, F[:0])


def test_flipped_faces_are_those_turned_beyond_a_right_angle():
    # Three triangles hinged on the x axis; their free corners turn by 80, 100 and 180 degrees.
    angle = np.radians([80, 100, 180])
    V0 = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 1, 0], [0, 1, 0]])
    V1 = V0.copy()
    V1[2:] = np.stack([np.zeros(3), np.cos(angle), np.sin(angle)], axis=1)
    F = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    assert flipped_faces(V0, V1, F) == 2
    assert flipped_faces(V0, V0, F) == 0


def test_faces_without_area_are_not_counted_as_flipped():
    V0 = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]])
    F = np.array([[0, 1, 2], [0, 0, 3], [0, 1, 3]])
    V1 = V0 * [1, -1, 1]
    V1[1] += [0, -1e-3, 0]
    # The first was a needle, the second has a corner twice; only the third really turned.
    assert flipped_faces(V0, V1, F) == 1
    V1[3] = [3, 0, 0]
    V1[1] = [1, 0, 0]
    assert flipped_faces(V0, V1, F) == 0


def test_normals_turn_by_the_slope_of_what_is_raised():
    V, F = plane(10, size=2.0)
    tilted = V + np.tan(np.radians(3.0)) * V[:, [0]] * [0, 0, 1]
    assert normal_turn(V, tilted, F) == pytest.approx(3.0)
    # One side of two, by area.
    bent = V + np.tan(np.radians(3.0)) * np.maximum(V[:, [0]] - 1.0, 0.0) * [0, 0, 1]
    assert normal_turn(V, bent, F) == pytest.approx(3.0 * math.sqrt(0.5), rel=1e-6)
    assert normal_turn(V, V, F) == 0.0
    assert normal_turn(np.zeros_like(V), V, F) == 0.0


def test_moves_are_counted_in_mean_edge_lengths():
    # A right triangle 3, 4, 5: mean edge 4.
    V = np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0]])
    F = np.array([[0, 1, 2]])
    assert max_move_edges(V, V + np.outer([2, 1, 0], up(1)), F) == pytest.approx(0.5)
    assert max_move_edges(V, V, F) == 0.0


def test_the_smallest_angle_lost_is_that_of_the_face_that_lost_most():
    # From 45 and 60 degrees: the first to atan(1/4), the second to 45 by lowering its apex.
    V0 = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, math.sqrt(0.75), 5], [0, 0, 5]])
    V0 = np.concatenate([V0, [[1.0, 0, 5]]])
    F = np.array([[0, 1, 2], [4, 5, 3]])
    V1 = V0.copy()
    V1[3] = [0.5, 0.5, 5]
    assert min_angle_change(V0, V1, F) == pytest.approx(15)
    V1[2] = [0, 0.25, 0]
    assert min_angle_change(V0, V1, F) == pytest.approx(45 - math.degrees(math.atan(0.25)))
    # What opens up is no loss, and neither is turning or scaling.
    assert min_angle_change(V1, V0, F) == 0.0
    assert min_angle_change(V0, 7 * V0[:, [2, 0, 1]], F) == pytest.approx(0, abs=1e-9)


def test_faces_without_area_have_no_angle_to_lose():
    V = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]])
    F = np.array([[0, 1, 2], [0, 0, 3], [0, 1, 3]])
    assert min_angle_change(V, V + np.outer([0, 1, 0, 0], [0, 1, 0]), F) == 0.0
    flat = V * [1, 0, 1]
    assert min_angle_change(V, flat, F) == pytest.approx(45)
    # A needle of a millionth: its angle is not lost to rounding.
    needle = V * [1, 1e-6, 1]
    assert min_angle_change(needle, flat, F) == pytest.approx(math.degrees(1e-6))


def test_distortion_gathers_the_measures_over_frames():
    V, F = plane(10, size=2.0)
    heights = [0.1, 0.2, 0.4]
    before = MeshAnimation.from_arrays(np.stack([V] * 3), F)
    after = MeshAnimation.from_arrays(np.stack([V + up(h) for h in heights]), F)
    found = distortion(before, after)
    mean = np.mean(heights)
    diagonal = 2 * math.sqrt(2)
    flickering = math.sqrt((0.01 + 0.04) / 2 / ((0.01 + 0.04 + 0.16) / 3))
    edge = (220 * 0.2 + 100 * 0.2 * math.sqrt(2)) / 320
    assert asdict(found) == pytest.approx(
        {
            "hausdorff": mean,
            "mrms": mean,
            "hausdorff_rel": mean / diagonal,
            "mrms_rel": mean / diagonal,
            "mrms_rel_error": 0.0,
            "compared_frames": 3,
            "flipped_faces": 0.0,
            "min_angle_change": 0.0,
            "normal_turn": 0.0,
            "max_move_edges": mean / edge,
            "texture_drift": math.nan,
            "flicker": flickering,
            "flicker_world": flickering,
            "jitter": math.inf,
        },
        nan_ok=True,
        abs=1e-7,
    )
    assert distortion(before, after, [0]).hausdorff == pytest.approx(0.1)
    some = distortion(before, after, [0, 2])
    # How far the vertices of all frames moved along their normals tells all of it here.
    assert some.mrms_rel == pytest.approx(mean / diagonal)
    assert some.mrms == pytest.approx(mean)
    assert some.mrms_rel_error == pytest.approx(0.0, abs=1e-8)
    assert some.hausdorff == pytest.approx(0.25)
    assert math.isnan(distortion(before, after, [1]).mrms_rel_error)
    # These are of all frames: neighbours are neighbours.
    assert some.flicker == pytest.approx(flickering)
    assert some.jitter == math.inf
    # Compared as text, because what is not a number does not equal itself.
    assert repr(pickle.loads(pickle.dumps(found))) == repr(found)


def test_a_mean_over_some_frames_is_carried_to_all_by_what_is_known_of_them():
    errors = np.zeros(2)
    # Values of variance 0.045 in two of three frames, of which nothing else is known.
    for hints in (np.full(3, math.nan), np.zeros(3), np.ones(3)):
        ratio, error = ratio_to_all(np.array([0.1, 0.4]), errors, hints, [0, 2])
        assert ratio == 1.0
        assert error == pytest.approx(math.sqrt(0.045 / 2 / 3))
    rng = np.random.default_rng(0)
    hints = rng.uniform(1.0, 2.0, 40)
    values = 0.3 * hints * rng.normal(1.0, 0.02, 40)
    misses = []
    for _ in range(200):
        some = np.sort(rng.choice(40, 8, replace=False))
        ratio, error = ratio_to_all(values[some], np.zeros(8), hints, some)
        misses.append((ratio * values[some].mean() - values.mean()) / error)
        assert error < 0.5 * standard_error(values[some], np.zeros(8), 40)
    assert np.sqrt(np.mean(np.square(misses))) == pytest.approx(1.0, abs=0.3)


def test_vertices_that_hardly_moved_need_no_distance():
    V, F = icosphere(3)
    rng = np.random.default_rng(0)
    W = V * (1.0 + 1e-3 * rng.random((len(V), 1)))
    W[7] *= 1.02
    same, others = (surface_distance(V, F, W, G, samples=500) for G in (F, F[:, [1, 2, 0]]))
    assert same.hausdorff == pytest.approx(others.hausdorff, rel=1e-6)
    assert same.hausdorff > 0.01


def test_relative_distances_do_not_depend_on_the_unit():
    ball = bending_ball()
    moved = ball.map(WobbleX())
    metres = ball.map(Scale(0.01))
    one, two = distortion(ball, moved), distortion(metres, moved.map(Scale(0.01)))
    assert two.hausdorff_rel == pytest.approx(one.hausdorff_rel)
    assert two.mrms_rel == pytest.approx(one.mrms_rel)
    assert two.mrms == pytest.approx(0.01 * one.mrms)
    assert two.flicker == pytest.approx(one.flicker)


def test_other_connectivities_are_compared_as_surfaces_only():
    V, F = plane(4)
    W, G = plane(5)
    still = [MeshAnimation.from_arrays(*mesh) for mesh in ((V, F), (W + up(0.5), G))]
    found = distortion(*still)
    assert found.hausdorff == pytest.approx(0.5)
    surface = {"hausdorff", "mrms", "hausdorff_rel", "mrms_rel", "mrms_rel_error"}
    surface.add("compared_frames")
    others = {name: value for name, value in asdict(found).items() if name not in surface}
    assert len(others) == 8
    assert all(math.isnan(value) for value in others.values())


def test_animations_of_different_lengths_cannot_be_compared():
    ball = bending_ball()
    with pytest.raises(UsageError, match="4 frames cannot be compared with 5"):
        distortion(ball, ball.select(range(4)))
    with pytest.raises(UsageError, match="no frame to compare"):
        distortion(ball, ball, [])


def test_polygons_are_measured_as_their_triangles():
    V = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    quad = Topology(np.array([4]), np.arange(4), 4)
    pair = [MeshAnimation.from_frames([Frame(1.0, V + up(z), quad)]) for z in (0, 0.5)]
    assert distortion(*pair).mrms == pytest.approx(0.5)


def test_a_hardly_shaken_horse_is_hardly_distorted(data_folder):
    from meshmark_plugins.readers.obj import ObjFrames

    horse = ObjFrames().read(str(data_folder / "horse-gallop-obj")).meshes[0].select([0, 1, 2])
    noisy = horse.map(WobbleX(1e-4))
    found = distortion(horse, noisy)
    assert 1e-6 < found.mrms_rel < 1e-4


class WobbleX:
    """Moves points along x, otherwise at each time."""

    def __init__(self, size: float = 0.01) -> None:
        self.size = size

    def __call__(self, frame: Frame) -> Frame:
        wave = self.size * np.sin(frame.points[:, [1]] * 5 + frame.time)
        return frame.moved(frame.points + wave * [1, 0, 0])


class Scale:
    """Scales points about the origin."""

    def __init__(self, factor: float) -> None:
        self.factor = factor

    def __call__(self, frame: Frame) -> Frame:
        return frame.moved(frame.points * self.factor)
