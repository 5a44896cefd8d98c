from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshmark.detection.reference_frame import MOST_GROUPS, EdgeLengths, readable
from meshmark.errors import InputError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.testing.meshes import icosphere

V, F = icosphere(2)
RNG = np.random.default_rng(0)


def bending(n_frames) -> np.ndarray:
    stretch = 1.0 + 0.2 * np.sin(np.arange(n_frames))
    return V * np.stack([stretch, 1 / stretch, np.ones(n_frames)], axis=1)[:, None]


def junk() -> np.ndarray:
    return RNG.permutation(V)


def animation(points) -> MeshAnimation:
    return MeshAnimation.from_arrays(np.array(points), F, prim="/Ball")


class Torn:
    """Frames of which some cannot be read."""

    def __init__(self, base, torn) -> None:
        self.base, self.torn = base, torn

    def frame(self, index) -> Frame:
        if index in self.torn:
            raise InputError("torn", prim="/Ball", time=float(index))
        return self.base.frame(index)


def torn(points, at) -> MeshAnimation:
    whole = animation(points)
    return replace(whole, source=Torn(whole.source, at))


def test_of_frames_that_agree_the_first_is_chosen() -> None:
    whole = animation(bending(30))
    assert EdgeLengths(whole).reference(range(30)) == 0
    assert EdgeLengths(whole).reference(range(7, 20)) == 7
    assert EdgeLengths(whole).groups() == [list(range(30))]


@pytest.mark.parametrize("n_junk", [1, 2, 5])
def test_junk_is_outvoted_wherever_it_stands(n_junk) -> None:
    good = list(bending(3))
    for place in range(4):
        points = [*good[:place], *(junk() for _ in range(n_junk)), *good[place:]]
        poses = [*range(place), *range(place + n_junk, n_junk + 3)]
        assert EdgeLengths(animation(points)).reference(range(len(points))) == poses[0]
        found = EdgeLengths(animation(points)).groups()
        assert found[0] == poses
        assert len(found) == min(1 + n_junk, MOST_GROUPS)


def test_where_no_frames_agree_the_least_stretched_is_chosen() -> None:
    whole = animation([junk(), V, junk()])
    assert EdgeLengths(whole).reference(range(3)) == 1
    assert [1] in EdgeLengths(whole).groups()


def test_frames_that_cannot_be_read_are_passed_over() -> None:
    whole = torn(bending(5), {0, 3})
    assert EdgeLengths(whole).reference(range(5)) == 1
    assert EdgeLengths(whole).groups() == [[0, 1, 2, 3, 4]]
    with pytest.raises(InputError, match="frame 3: torn"):
        EdgeLengths(whole).reference([3, 0])
    with pytest.raises(InputError, match="frame 0: torn"):
        EdgeLengths(torn(bending(3), {0, 1, 2})).groups()


def test_frames_that_show_nothing_cannot_be_read() -> None:
    points = bending(3)
    points[1, 7] = np.nan
    points[2] = 5.0
    whole = animation(points)
    assert readable(whole, 0).time == 1.0
    with pytest.raises(InputError, match=r"/Ball: frame 2: point 7 is not finite: \[nan"):
        readable(whole, 1)
    with pytest.raises(InputError, match="/Ball: frame 3: the mesh has no extent"):
        readable(whole, 2)
