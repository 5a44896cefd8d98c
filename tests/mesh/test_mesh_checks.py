"""Which frames of an animation nothing can be measured in, and why."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshmark.errors import InputError, NoExtentError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.checks import bad_frames, check
from meshmark.testing.attacks import sphere

V, F = sphere(60)


def animation(*frames: np.ndarray) -> MeshAnimation:
    return replace(MeshAnimation.from_arrays(np.stack(frames), F, prim="/ball"), origin="a.usd")


@pytest.mark.filterwarnings("error")
def test_sound_frames_are_not_listed() -> None:
    sound = animation(V, 1e-30 * V, 1e30 * V, 3e38 * V, V + 1e6, V * [1, 1, 1e-6])
    assert bad_frames(sound) == ()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e39])
def test_a_point_beyond_measure_is_named_with_its_frame(value: float) -> None:
    bad = V.copy()
    bad[7, 1] = value
    ((index, error),) = bad_frames(animation(bad, V, V))
    assert index == 0
    assert str(error).startswith("a.usd: /ball: frame 1: point 7 is ")
    with pytest.raises(InputError, match="point 7"):
        check(animation(V, bad))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "nothing",
    [0.0 * V, 0.0 * V + 1e6, 1e-200 * V, V * [1, 0, 0], V * [1e-30, 1, 1e-30], V @ np.ones((3, 3))],
)
def test_a_mesh_scaled_to_nothing_is_listed_but_no_fault(nothing: np.ndarray) -> None:
    ((index, error),) = bad_frames(animation(V, nothing, V))
    assert index == 1
    assert isinstance(error, NoExtentError)
    check(animation(V, nothing, V))


def test_points_that_no_face_uses_give_no_extent() -> None:
    far = np.zeros_like(V)
    far[-1] = 100.0
    ((_, error),) = bad_frames(MeshAnimation.from_arrays(far, F[(len(V) - 1 != F).all(axis=1)]))
    assert isinstance(error, NoExtentError)


def test_frames_that_raise_are_listed_and_bugs_pass() -> None:
    def spoil(frame: Frame) -> Frame:
        if frame.time == 2:
            raise InputError("torn")
        return frame

    ((index, error),) = bad_frames(animation(V, V, V).map(spoil))
    assert (index, str(error)) == (1, "a.usd: /ball: frame 2: torn")
    with pytest.raises(ZeroDivisionError):
        bad_frames(animation(V).map(lambda _: 1 / 0))
