"""A copy that stands where it was written is placed without a search; any other is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from alignment_shapes import nodding, placed, shuffled, similarity
from meshmark.alignment.in_place import FEWEST, in_place
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset, as_asset

ORIGINAL = nodding(2, 9)
N = ORIGINAL[0].topology.n_points
# What a mark may move points by.
MARKED = ORIGINAL.map(lambda frame: frame.moved(1.001 * frame.points))


def test_frames_are_placed_at_their_times_by_the_identity() -> None:
    copy = as_asset(MARKED.select([1, 4, 8]))
    found = in_place(copy, as_asset(ORIGINAL), 3 * N)
    assert found is not None
    [mesh] = found.meshes
    assert (mesh.method, mesh.prims) == ("identity", ("/body",))
    assert [(each.index, each.pose) for each in mesh.frames] == [(0, 1.0), (1, 4.0), (2, 8.0)]
    for each in mesh.frames:
        P = ORIGINAL[0].points
        assert list(each.maps) == ["similarity"]
        np.testing.assert_allclose(each.maps["similarity"](P), P, atol=1e-14)
        assert 0.0 < each.residual < 1e-3


@pytest.mark.parametrize(
    ("n_points", "frames"), [(0, FEWEST), (5 * N, 5), (100 * N, 9), (np.inf, 9)]
)
def test_so_many_points_are_read_but_a_few_frames_at_least(n_points, frames) -> None:
    found = in_place(as_asset(MARKED), as_asset(ORIGINAL), n_points)
    assert found is not None
    indices = [each.index for each in found.meshes[0].frames]
    assert len(indices) == frames
    assert (indices[0], indices[-1]) == (0, 8)


@pytest.mark.parametrize(
    "copy",
    [
        placed(ORIGINAL, similarity(1)),
        replace(shuffled(ORIGINAL), prim="/body"),
        replace(MARKED, times=MARKED.times + 0.5),
        replace(MARKED, prim="/other"),
        replace(MARKED, constant_topology=False),
    ],
    ids=["moved", "reordered", "other times", "other prim", "changing"],
)
def test_what_does_not_stand_there_has_to_be_looked_for(copy: MeshAnimation) -> None:
    assert in_place(as_asset(copy), as_asset(ORIGINAL), np.inf) is None


def test_all_meshes_must_stand_there() -> None:
    other = replace(ORIGINAL, prim="/other")
    both = Asset("both.usda", (ORIGINAL, other), "memory")
    copy = Asset("copy.usda", (other, MARKED), "memory")
    found = in_place(copy, both, 0)
    assert found is not None
    assert [mesh.prims for mesh in found.meshes] == [("/body",), ("/other",)]
    assert in_place(as_asset(MARKED), both, 0) is None


def test_a_mesh_without_times_stands_there() -> None:
    still = ORIGINAL.select([0])
    still = replace(still, times=np.array([np.nan]))
    found = in_place(as_asset(still), as_asset(still), np.inf)
    assert found is not None
    assert [each.pose for each in found.meshes[0].frames] == [0.0]
