from __future__ import annotations

import numpy as np
import pytest

from meshmark.detection.unsmoothing import STEPS, unsmoothed
from meshmark.mesh.animation import Frame
from meshmark.mesh.smoothing import polygon_umbrella, smooth
from meshmark.mesh.topology import Topology
from meshmark.testing.meshes import icosphere, plane


@pytest.fixture
def bumpy() -> Frame:
    V, F = icosphere(4)
    V = V * (1 + 0.02 * np.sin(20 * V[:, :1]) * np.cos(17 * V[:, 1:2]))
    return Frame(1.0, V, Topology.from_triangles(F, len(V)))


def unsmooth(frame: Frame, n: int) -> Frame:
    (restored,) = unsmoothed(frame, [n])
    return restored


def test_several_amounts_are_undone_at_once(bumpy) -> None:
    together = unsmoothed(bumpy, [50, 0, 10, 50])
    assert together[1] is bumpy
    for n, restored in zip([50, 10, 50], [together[0], *together[2:]], strict=True):
        np.testing.assert_array_equal(restored.points, unsmooth(bumpy, n).points)


@pytest.mark.parametrize(("n", "atol"), [(10, 1e-13), (30, 1e-7), (50, 1e-5)])
def test_the_filter_is_the_repeated_correction(bumpy, n, atol) -> None:
    L = polygon_umbrella(bumpy.topology)
    smoothed = smooth(bumpy.points, L, n)
    X = smoothed
    for _ in range(STEPS):
        X = X + (smoothed - smooth(X, L, n))
    np.testing.assert_allclose(unsmooth(bumpy.moved(smoothed), n).points, X, atol=atol)


@pytest.mark.parametrize(("n", "gain"), [(10, 20.0), (30, 3.0), (50, 1.5)])
def test_it_brings_back_what_smoothing_took(bumpy, n, gain) -> None:
    smoothed = bumpy.moved(smooth(bumpy.points, polygon_umbrella(bumpy.topology), n))
    lost = np.abs(smoothed.points - bumpy.points).max()
    left = np.abs(unsmooth(smoothed, n).points - bumpy.points).max()
    assert left < lost / gain


@pytest.mark.parametrize("n", [10, 30, 50])
def test_the_shape_is_the_same_far_from_the_origin(bumpy, n) -> None:
    near = unsmooth(bumpy, n).points
    far = unsmooth(bumpy.moved(bumpy.points + np.array([1e3, 0.0, -1e3])), n).points
    gap = far - near
    np.testing.assert_allclose(gap, np.tile(gap.mean(axis=0), (len(gap), 1)), atol=1e-9)


def test_what_was_not_smoothed_is_left_alone(bumpy) -> None:
    assert unsmooth(bumpy, 0) is bumpy


def test_borders_stay() -> None:
    V, F = plane(12)
    V = V + 0.05 * np.sin(9 * V[:, :1]) * [0.0, 0.0, 1.0]
    frame = Frame(1.0, V, Topology.from_triangles(F, len(V)))
    border = (np.abs(V[:, :2] - 0.5) > 0.4999).any(axis=1)
    restored = unsmooth(frame, 30).points
    np.testing.assert_allclose(restored[border], V[border], atol=1e-7)
    assert np.abs(restored[~border] - V[~border]).max() > 1e-3
