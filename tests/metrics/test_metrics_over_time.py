from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from meshmark.metrics import (
    flicker,
    flicker_world,
    jitter,
)
from meshmark.metrics.motion import MOST_VERTICES, Flicker
from meshmark.testing.attacks import sphere
from meshmark.testing.meshes import icosphere

ALTERNATING = np.array([1, -1, 1, -1, 1, -1])[:, None, None]


def test_jitter_of_a_wave_on_a_wave():
    # On sines of one phase, acceleration is (2 pi f)^2 of the size: a fifth as large and three
    # times as fast makes nine fifths, but for what the finite step takes.
    t = np.arange(401) / 400
    shape = np.random.default_rng(0).normal(size=(1, 50, 3))
    P = np.sin(2 * np.pi * t)[:, None, None] * shape
    D = 0.2 * np.sin(2 * np.pi * 3 * t)[:, None, None] * shape
    assert jitter(P, D, t) == pytest.approx(1.8, rel=1e-3)
    assert jitter(P + t[:, None, None] * [5, 0, 0], D, t) == pytest.approx(1.8, rel=1e-3)
    assert jitter(P, 0.1 * P + 3 * shape, t) == pytest.approx(0.1)
    assert jitter(P, 0 * D) == 0.0
    assert jitter(0 * P, D) == math.inf
    assert math.isnan(jitter(P[:2], D[:2]))


def test_jitter_knows_the_time_between_frames():
    # A parabola has the same acceleration wherever it is sampled.
    t = np.array([0.0, 1, 3, 4, 8, 8.5])
    P = (t**2)[:, None, None] * np.ones((1, 7, 3))
    D = (0.3 * t**2 - t + 2)[:, None, None] * np.ones((1, 7, 3))
    assert jitter(P, D, t) == pytest.approx(0.3)


def test_flicker_of_known_displacements_on_a_surface_at_rest():
    V, F = sphere(400)
    P = np.repeat(V[None], 60, axis=0)
    D = np.random.default_rng(0).normal(size=(1, 400, 3))
    still = np.repeat(D, 6, axis=0)
    fresh = np.random.default_rng(1).normal(size=(60, 400, 3))
    # A sine of period 60 changes by 2 sin(pi / 60) of its size a frame.
    wave = np.sin(2 * np.pi * np.arange(60) / 60)[:, None, None] * D
    for measure in (flicker_world, lambda D: flicker(P[: len(D)], D, F)):
        assert measure(still) == pytest.approx(0, abs=1e-12)
        assert measure(still * ALTERNATING) == pytest.approx(2)
        assert measure(fresh) == pytest.approx(math.sqrt(2), rel=0.02)
        assert measure(0 * still) == 0.0
        assert measure(D) == 0.0
        assert measure(wave) == pytest.approx(2 * math.sin(math.pi / 60), rel=0.02)


def test_what_is_glued_to_a_turning_mesh_rests_on_it_but_not_in_space():
    V, F = sphere(400)
    angle = np.radians(20)
    turns = Rotation.from_rotvec(np.outer(np.arange(6) * angle, [0, 0, 1])).as_matrix()
    D = np.random.default_rng(0).normal(size=(400, 3))
    # A displacement along the axis does not turn.
    D[:, 2] = 0
    P, glued = (X @ np.swapaxes(turns, 1, 2) for X in (V, D))
    P += np.arange(6)[:, None, None] * [3, 2, 1]
    assert flicker(P, glued, F) == pytest.approx(0, abs=1e-12)
    assert flicker_world(glued) == pytest.approx(2 * math.sin(angle / 2))
    assert flicker(P, glued * ALTERNATING, F) == pytest.approx(2)
    assert flicker_world(glued * ALTERNATING) == pytest.approx(2 * math.cos(angle / 2))
    # And what stays in space slides over the surface.
    assert flicker(P, np.stack([D] * 6), F) == pytest.approx(2 * math.sin(angle / 2))


def test_what_is_glued_to_a_growing_mesh_grows_with_it():
    V, F = sphere(400)
    D = np.random.default_rng(0).normal(size=(400, 3))
    growth = np.array([1.0, 2, 4, 8])[:, None, None]
    assert flicker(growth * V, growth * D, F) == pytest.approx(0, abs=1e-12)
    # Steps of 1, 2 and 4 between sizes of 1, 2, 4 and 8.
    assert flicker_world(growth * D) == pytest.approx(math.sqrt((21 / 3) / (85 / 4)))


def test_flicker_is_not_taken_across_a_change_of_faces():
    V, F = sphere(60)
    D = np.random.default_rng(0).normal(size=(60, 3))
    total = Flicker()
    for sign, faces in [(1, F), (-1, F[::-1]), (-1, F[::-1])]:
        total.add(V, sign * D, faces)
    assert total.ratio() == pytest.approx(0, abs=1e-12)
    assert total.ratio_world() == 0.0


def test_flicker_of_many_vertices_is_measured_at_some():
    V, F = icosphere(5)
    assert len(V) > 2 * MOST_VERTICES
    D = np.random.default_rng(0).normal(size=V.shape)
    P = np.stack([V, V, V])
    assert flicker(P, np.stack([D, -D, D]), F) == pytest.approx(2)
    assert flicker(P, np.stack([D, 1.5 * D, D]), F) == pytest.approx(0.5 / math.sqrt(4.25 / 3))
