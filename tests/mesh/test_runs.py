"""Runs of frames with one connectivity: where they begin and end, cut out and put back."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from meshmark.errors import InputError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.runs import cut, joined, longest, runs, span
from meshmark.mesh.topology import Topology
from meshmark.testing.meshes import icosphere


def frame(time: float, level: int, *, flipped: bool = False) -> Frame:
    V, F = icosphere(level)
    return Frame(time, V * time, Topology.from_triangles(F[:, ::-1] if flipped else F, len(V)))


@pytest.fixture
def changing() -> MeshAnimation:
    """Return A A B A' A': A' has the points of A, and its faces the other way round."""
    frames = [frame(1, 0), frame(2, 0), frame(3, 1)]
    frames += [frame(t, 0, flipped=True) for t in (4, 7)]
    return MeshAnimation.from_frames(frames, prim="/sim")


def test_runs_end_where_points_or_faces_change(changing) -> None:
    assert runs(changing) == [range(2), range(2, 3), range(3, 5)]
    assert [span(cut(changing, run)) for run in runs(changing)] == ["1:2", "3:3", "4:7"]


def test_without_change_there_is_one() -> None:
    still = MeshAnimation.from_frames([frame(t, 0) for t in (1, 2, 3)])
    assert runs(still) == [range(3)]
    assert cut(still, range(3)).constant_topology


def test_frames_that_cannot_be_read_belong_to_none(changing) -> None:
    def spoil(each: Frame) -> Frame:
        if each.time == 2:
            raise InputError("spoilt")
        return each

    assert runs(changing.map(spoil)) == [range(1), range(2, 3), range(3, 5)]


def test_what_is_cut_is_an_animation_of_its_own(changing) -> None:
    part = cut(changing, range(3, 5))
    assert part.constant_topology
    assert (part.prim, part.times.tolist()) == ("/sim", [4.0, 7.0])
    np.testing.assert_array_equal(part[1].points, changing[4].points)


def test_parts_are_put_back_in_their_places(changing) -> None:
    at = [range(2), range(3, 5)]
    parts = [cut(changing, run).map(lambda each: each.moved(-each.points)) for run in at]
    whole = joined(changing, at, parts)
    assert not whole.constant_topology
    for index, each in enumerate(whole):
        sign = 1 if index == 2 else -1
        np.testing.assert_array_equal(each.points, sign * changing[index].points)
        assert each.topology.same_as(changing[index].topology)
    same = pickle.loads(pickle.dumps(joined(changing, at, [cut(changing, run) for run in at])))
    np.testing.assert_array_equal(same[4].points, changing[4].points)


def test_the_longest_are_chosen_and_equal_ones_are_spread() -> None:
    every = [range(1), range(1, 5), range(5, 6), range(6, 9)]
    assert longest(every, 2) == [range(1, 5), range(6, 9)]
    assert longest(every, 9) == every
    single = [range(i, i + 1) for i in range(9)]
    assert longest(single, 3) == [single[0], single[4], single[8]]
