"""Alignment of assets: several meshes, split, joined and missing ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from alignment_shapes import errors, mapped, nodding, placed, shuffled, similarity
from meshmark.alignment.align import align, align_mesh
from meshmark.alignment.pieces import joined
from meshmark.arrays import IntArray
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.testing.meshes import bent_tube, icosphere, plane, side_by_side


def asset(*meshes: MeshAnimation) -> Asset:
    return Asset("memory", meshes, "memory")


def piece(mesh: MeshAnimation, faces: IntArray, prim: str) -> MeshAnimation:
    """Keep some triangles, and the points they use."""
    used, F = np.unique(mesh[0].faces[faces], return_inverse=True)
    stack = np.stack([frame.points[used] for frame in mesh])
    return MeshAnimation.from_arrays(stack, F.reshape(-1, 3), prim=prim)


def tube() -> MeshAnimation:
    V, F = bent_tube(16, 30, angle=1.0)
    V = V + np.outer(np.maximum(V[:, 2], 0.0) ** 2, [0.02, 0.05, 0.0])
    return MeshAnimation.from_arrays(np.repeat(V[None], 5, axis=0), F, prim="/tube")


@pytest.mark.slow
def test_each_mesh_finds_its_own() -> None:
    A = similarity(2)
    original = asset(nodding(), tube())
    found = align(asset(placed(tube(), A), placed(shuffled(nodding()), A)), original)
    assert not found.unplaced
    assert [each.original.prim for each in found.meshes] == ["/body", "/tube"]
    assert [each.method for each in found.meshes] == ["pca", "identity"]
    assert max(errors(each, A).max() for each in found.meshes) < 1e-6


def test_pieces_are_put_together_and_strangers_left_out() -> None:
    A, body = similarity(4), placed(nodding(), similarity(4))
    middle = body[0].points[body[0].faces].mean(axis=1) @ np.array([1.0, 0.3, -0.2])
    low = middle < np.quantile(middle, 0.5)
    halves = [piece(body, np.flatnonzero(side), f"/{side[0]}") for side in (low, ~low)]
    V, F = plane(12, 5.0)
    stranger = MeshAnimation.from_arrays(np.repeat(V[None] + 50.0, 5, axis=0), F, prim="/floor")
    for pieces in (halves, [*halves, stranger]):
        found = align(asset(*pieces), asset(nodding()))
        [each] = found.meshes
        assert {mesh.prim for mesh in each.copy} == {mesh.prim for mesh in halves}
        assert errors(each, A).max() < 1e-6
        assert each.covered > 0.95


@pytest.mark.slow
def test_what_is_joined_to_a_copy_does_not_matter() -> None:
    A, body = similarity(6), nodding(3, 2)
    ground = plane(30, 12.0)
    stack, faces = [], body[0].faces
    for frame in body:
        V, faces = side_by_side((frame.points, frame.faces), (ground[0] - 6.0, ground[1]))
        stack.append(mapped(A, V))
    found = align_mesh(MeshAnimation.from_arrays(np.stack(stack), faces), body, [0, 1])
    assert errors(found, A).max() < 1e-6
    assert found.frames[1].pose == 1.0


def united(*meshes: MeshAnimation) -> MeshAnimation:
    """Join meshes that share their times into one."""
    whole = joined(meshes)
    assert whole is not None
    return replace(whole, prim="/joined")


def test_meshes_that_were_joined_are_found_each_by_its_own_vertices() -> None:
    A, other = similarity(2), tube()
    apart = placed(other, np.column_stack([np.eye(3), [3.0, 0.0, 0.0]]))
    copy = asset(placed(united(nodding(), apart), A))
    found = align(copy, asset(apart, nodding()))
    assert not found.unplaced
    assert [(each.original.prim, each.method) for each in found.meshes] == [
        ("/tube", "identity"),
        ("/body", "identity"),
    ]
    assert {mesh.prim for each in found.meshes for mesh in each.copy} == {"/joined"}
    assert max(errors(each, A).max() for each in found.meshes) < 1e-6


def balls() -> list[MeshAnimation]:
    """Place balls of several sizes where no turn takes them to each other."""
    V, F = icosphere(2)
    rng = np.random.default_rng(5)
    return [
        MeshAnimation.from_arrays(size * V + rng.uniform(-8, 8, 3), F, prim=f"/ball_{n}")
        for n, size in enumerate((1.0, 0.8, 1.3, 0.7, 0.9))
    ]


@pytest.mark.slow
def test_joined_balls_are_found_where_all_of_them_together_lie() -> None:
    """Each alone would fit turned in any way."""
    A, original = similarity(3), balls()
    for copy in (
        asset(placed(shuffled(united(*original)), A)),
        asset(*(placed(shuffled(ball), A) for ball in original)),
    ):
        found = align(copy, asset(*original))
        assert not found.unplaced
        assert [each.original.prim for each in found.meshes] == [ball.prim for ball in original]
        assert max(errors(each, A).max() for each in found.meshes) < 1e-3


@pytest.mark.slow
def test_halves_of_balls_are_put_together() -> None:
    A, original = similarity(3), balls()
    halves = []
    for ball in original:
        F = ball[0].faces
        low = ball[0].points[F].mean(axis=1)[:, 2] < ball[0].points[:, 2].mean()
        halves += [
            piece(placed(ball, A), np.flatnonzero(side), f"{ball.prim}_{side[0]}")
            for side in (low, ~low)
        ]
    found = align(asset(*halves), asset(*original))
    assert not found.unplaced
    assert all(len(each.copy) == 2 and each.covered > 0.95 for each in found.meshes)
    assert max(errors(each, A).max() for each in found.meshes) < 1e-3


def test_a_mesh_that_the_copy_lacks_is_told() -> None:
    found = align(asset(placed(nodding(), similarity(1))), asset(nodding(), tube()))
    assert [each.original.prim for each in found.meshes] == ["/body"]
    assert [(each.prim, each.reason) for each in found.unplaced] == [
        ("/tube", "nothing of the copy is left for it")
    ]
