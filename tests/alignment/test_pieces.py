"""Meshes of a copy that were joined, taken apart again."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.alignment.pieces import MOST_PIECES, joined, pieces
from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.animation import MeshAnimation
from meshmark.testing.meshes import bent_tube, icosphere, side_by_side, torus

Shape = tuple[FloatArray, IntArray]


def mesh(*shapes: Shape, frames: int = 2, prim: str = "/copy") -> MeshAnimation:
    """Join shapes, and let them move."""
    V, F = shapes[0]
    for shape in shapes[1:]:
        V, F = side_by_side((V, F), shape)
    stack = np.stack([V + 0.1 * t for t in range(frames)])
    return MeshAnimation.from_arrays(stack, F, prim=prim)


def size(shape: Shape) -> tuple[int, int]:
    return len(shape[0]), len(shape[1])


@pytest.fixture
def shapes() -> list[Shape]:
    return [(V + 5.0 * n, F) for n, (V, F) in enumerate((icosphere(2), torus(20, 10)))]


def test_each_of_several_meshes_is_found_with_all_of_its_vertices(shapes) -> None:
    # The second has two surfaces, and points that no face uses.
    V, F = side_by_side(shapes[0], shapes[1])
    two = (np.concatenate([V, V[:3]]), F)
    tube = bent_tube(8, 10)
    copy = mesh(tube, two, shapes[0])
    found = pieces(copy, [size(shapes[0]), size(two)])
    assert [piece[0].topology.n_points for piece in found] == sorted(
        (len(two[0]), len(shapes[0][0]), len(tube[0])), reverse=True
    )
    largest = found[0]
    np.testing.assert_array_equal(largest[0].faces, two[1])
    for t in range(2):
        np.testing.assert_array_equal(
            largest[t].points, copy[t].points[len(tube[0]) :][: len(two[0])]
        )
    assert {piece.prim for piece in found} == {"/copy"}


def test_what_is_of_no_known_size_falls_into_its_surfaces(shapes) -> None:
    copy = mesh(*shapes)
    rng = np.random.default_rng(0)
    order = rng.permutation(copy[0].topology.n_points)
    mixed = MeshAnimation.from_arrays(
        np.stack([frame.points[order] for frame in copy]), np.argsort(order)[copy[0].faces]
    )
    found = pieces(mixed, [size(shape) for shape in shapes])
    assert sorted(piece[0].topology.n_points for piece in found) == sorted(
        len(V) for V, _ in shapes
    )
    # Each of its faces has points of its own: what lies together is together.
    F = copy[0].faces
    soup = MeshAnimation.from_arrays(
        copy[0].points[F].reshape(-1, 3), np.arange(F.size).reshape(-1, 3)
    )
    assert sorted(len(piece[0].faces) for piece in pieces(soup, [(1, 1)])) == sorted(
        len(F) for _, F in shapes
    )


def test_a_mesh_of_the_original_and_one_surface_stay_whole(shapes) -> None:
    both = mesh(*shapes)
    assert pieces(both, [(both[0].topology.n_points, len(both[0].faces))]) == [both]
    alone = mesh(shapes[0])
    assert pieces(alone, [(3, 1)]) == [alone]


def test_of_very_many_surfaces_the_small_ones_stay_together() -> None:
    V, F = icosphere(0)
    copy = mesh(icosphere(1), *((V + 3.0 * n, F) for n in range(1, MOST_PIECES + 5)))
    found = pieces(copy, [(3, 1)])
    assert len(found) == MOST_PIECES
    assert sum(len(piece[0].faces) for piece in found) == len(copy[0].faces)


def test_originals_are_joined_if_they_share_their_times(shapes) -> None:
    one, two = (mesh(shape) for shape in shapes)
    whole = joined([one, two])
    assert whole is not None
    np.testing.assert_array_equal(whole[1].points, np.concatenate([one[1].points, two[1].points]))
    np.testing.assert_array_equal(whole[0].faces, mesh(*shapes)[0].faces)
    assert joined([one, mesh(shapes[1], frames=3)]) is None
