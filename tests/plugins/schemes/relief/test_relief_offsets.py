"""Heights of single vertices: exact, however the copy was aligned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshmark.extension.informed import AlignedFrame
from meshmark.mesh.animation import Frame
from meshmark.mesh.geometry import surface_box, vertex_normals
from meshmark.mesh.topology import Topology
from meshmark.testing.informed_schemes import HORNS
from meshmark.testing.meshes import bumpy_sphere, icosphere
from meshmark_plugins.schemes.relief.offsets import (
    FEWEST,
    MOST_VERTICES,
    Offsets,
    mean_height,
    offsets,
    sampled,
)


def frame_of(mesh) -> Frame:
    V, F = mesh
    return Frame(1.0, V, Topology.from_triangles(F, len(V)))


HORNED, SPHERE = frame_of(bumpy_sphere(3, HORNS, 1.0, 0.35)), frame_of(icosphere(3))
HEIGHT = 1e-4


def view(frame: Frame, points, motion=None, vertices=None) -> AlignedFrame:
    motion = np.zeros_like(frame.points) if motion is None else motion
    vertices = np.arange(len(points)) if vertices is None else vertices
    return AlignedFrame(frame, motion, points, vertex_normals(points, frame.faces), vertices)


def raised(frame: Frame, seed: int = 0):
    """Heights far from mean 0, as those of the lowest of many copies are; and the points."""
    size = HEIGHT * surface_box(frame.points, frame.faces)[0]
    f = size * (np.random.default_rng(seed).normal(size=len(frame.points)) - 1.5)
    return f, frame.points + f[:, None] * vertex_normals(frame.points, frame.faces), size


@pytest.mark.parametrize("warp", ["none", "scale", "affine", "motion"])
def test_heights_are_exact_though_the_copy_lies_a_little_off(warp) -> None:
    f, P, size = raised(HORNED)
    rng = np.random.default_rng(1)
    motion = rng.normal(size=P.shape)
    motion += 3.0 * vertex_normals(HORNED.points, HORNED.faces)
    if warp == "scale":
        P = P * (1.0 + 3.0 * HEIGHT) + 2.0 * size
    elif warp == "affine":
        P = P @ (np.eye(3) + 3.0 * HEIGHT * rng.normal(size=(3, 3)))
    elif warp == "motion":
        P = P + 2.0 * size * motion
    found = offsets(view(HORNED, P, motion if warp == "motion" else None))
    np.testing.assert_allclose(found.height, f, atol=0.02 * size)
    assert found.deviation < 0.01 * size


def test_a_ball_stays_as_large_as_it_was_aligned() -> None:
    """No offset along a sphere tells its size, which heights alone do not decide."""
    f, P, size = raised(SPHERE)
    found = offsets(view(SPHERE, P))
    np.testing.assert_allclose(found.height, f, atol=0.1 * size)


def test_what_nobody_touched_has_no_height() -> None:
    V = HORNED.points
    np.testing.assert_allclose(offsets(view(HORNED, V)).height, 0.0, atol=1e-12)
    f, P, size = raised(HORNED)
    untouched = np.arange(len(V)) % 4 > 0
    found = offsets(view(HORNED, np.where(untouched[:, None], V, P)))
    np.testing.assert_allclose(found.height, np.where(untouched, 0.0, f), atol=0.02 * size)


def test_noise_is_measured_along_the_surface() -> None:
    f, P, size = raised(HORNED)
    noise = 0.5 * size * np.random.default_rng(2).normal(size=P.shape)
    found = offsets(view(HORNED, P + noise))
    assert found.deviation == pytest.approx(0.5 * size, rel=0.1)
    assert (found.height - f).std() == pytest.approx(0.5 * size, rel=0.1)


def test_vertices_in_another_order_are_found_where_they_lie() -> None:
    f, P, size = raised(HORNED)
    order = np.random.default_rng(3).permutation(len(P))[: len(P) // 2]
    shuffled = replace(view(HORNED, P * (1.0 + HEIGHT)), vertices=None)
    found = offsets(replace(shuffled, points=shuffled.points[order]))
    there = np.zeros(len(P), dtype=bool)
    there[order] = True
    np.testing.assert_array_equal(np.isnan(found.height), ~there)
    np.testing.assert_allclose(found.height[there], f[there], atol=0.02 * size)


def test_vertices_that_lie_next_to_none_tell_nothing() -> None:
    _, P, _ = raised(HORNED)
    middle = P[HORNED.faces].mean(axis=1)
    assert np.isnan(offsets(replace(view(HORNED, P), points=middle, vertices=None)).height).all()
    few = np.arange(FEWEST - 1)
    found = offsets(replace(view(HORNED, P), points=P[few], vertices=few))
    assert np.isnan(found.height).all()


def test_missing_vertices_are_unknown_and_doubled_ones_averaged() -> None:
    f, P, size = raised(HORNED)
    there = np.r_[np.arange(100, len(P)), np.arange(200, 300)]
    moved = P[there].copy()
    moved[-100:] += size * vertex_normals(HORNED.points, HORNED.faces)[200:300]
    found = offsets(replace(view(HORNED, P), points=moved, vertices=there))
    assert np.isnan(found.height[:100]).all()
    np.testing.assert_allclose(found.height[200:300], f[200:300] + 0.5 * size, atol=0.02 * size)


def test_frames_count_by_how_little_they_were_disturbed() -> None:
    good, bad = np.array([1.0, 2.0, np.nan, np.nan]), np.array([5.0, np.nan, 7.0, np.nan])
    found = mean_height([Offsets(good, 0.1), Offsets(bad, 0.2), Offsets(bad, np.inf)])
    np.testing.assert_allclose(found, [(4.0 * 1.0 + 5.0) / 5.0, 2.0, 7.0, np.nan])
    nothing = np.full(4, np.nan)
    assert np.isnan(mean_height([Offsets(nothing, np.inf)])).all()


def test_no_more_vertices_are_looked_at_than_a_file_may_hold() -> None:
    np.testing.assert_array_equal(sampled(5), np.arange(5))
    many = sampled(100 * MOST_VERTICES)
    assert len(many) == MOST_VERTICES
    assert (many[0], many[-1]) == (0, 100 * MOST_VERTICES - 1)
