"""Patches: of equal area, numbered along a curve, the same whoever makes them."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark import read
from meshmark.commands.attack import write_attacked
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import as_asset
from meshmark.mesh.geometry import lengths, vertex_areas
from meshmark.testing.meshes import Mesh, icosphere, plane, side_by_side, torus
from meshmark_plugins.schemes.relief import patches
from meshmark_plugins.schemes.relief.patches import patch_labels

SHAPES = {"sphere": icosphere(4), "torus": torus(96, 40), "plane": plane(50)}


def areas(mesh: Mesh, label) -> np.ndarray:
    return np.bincount(label, vertex_areas(*mesh))


@pytest.mark.parametrize("name", SHAPES)
def test_patches_have_about_the_same_area(name) -> None:
    mesh = SHAPES[name]
    # About 12 vertices a patch: whole vertices alone make areas differ by some 10 %.
    area = areas(mesh, patch_labels(*mesh, 200))
    assert len(area) == 200
    assert area.std() < 0.25 * area.mean()
    assert area.min() > 0.3 * area.mean()
    assert area.max() < 2.0 * area.mean()


@pytest.mark.parametrize("name", SHAPES)
def test_patches_hang_together(name) -> None:
    V, F = SHAPES[name]
    label = patch_labels(V, F, 100)
    inside = label[F[:, 0]] == label[F[:, 1]]
    # Each vertex of a patch of several has a neighbour in it.
    near = np.zeros(len(V), dtype=bool)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        inside = label[F[:, i]] == label[F[:, j]]
        near[F[inside][:, [i, j]]] = True
    assert near.all()


@pytest.mark.parametrize("name", SHAPES)
def test_patches_are_numbered_along_a_curve(name) -> None:
    V, F = SHAPES[name]
    label = patch_labels(V, F, 200)
    centre = np.stack([np.bincount(label, x) / np.bincount(label) for x in V.T], axis=1)
    step = np.linalg.norm(np.diff(centre, axis=0), axis=1)
    shuffled = centre[np.random.default_rng(0).permutation(len(centre))]
    anywhere = np.linalg.norm(np.diff(shuffled, axis=0), axis=1)
    assert np.median(step) < 0.25 * np.median(anywhere)


def test_patches_are_the_same_after_reading_again(tmp_path) -> None:
    V, F = torus(48, 20)
    stored = MeshAnimation.from_arrays(V.astype(np.float32).astype(np.float64)[None], F)
    write_attacked(as_asset(stored), tmp_path / "torus.usdc")
    again = read(tmp_path / "torus.usdc").meshes[0][0]
    before = patch_labels(stored[0].points, stored[0].faces, 80)
    np.testing.assert_array_equal(patch_labels(again.points, again.faces, 80), before)


def test_components_share_patches_by_their_area() -> None:
    V, F = icosphere(3)
    pair = side_by_side((V, F), (0.5 * V + (3.0, 0.0, 0.0), F))
    label = patch_labels(*pair, 200)
    large, small = set(label[: len(V)]), set(label[len(V) :])
    assert not large & small
    # The small one has a fifth of the area.
    assert 30 <= len(small) <= 50
    assert len(large | small) == 200


def test_every_component_of_a_patch_or_more_has_one() -> None:
    V, F = icosphere(1)
    balls = [(V * (1.0 + 0.1 * (i % 5)) + (4.0 * i, 0.0, 0.0), F) for i in range(12)]
    label = patch_labels(*side_by_side(*balls), 60)
    own = [set(label[len(V) * i : len(V) * (i + 1)]) for i in range(12)]
    assert all(own)
    assert sum(map(len, own)) == len(set(label))


def test_specks_and_loose_points_belong_to_the_patch_nearest_in_space() -> None:
    V, F = icosphere(3)
    speck = (np.array([[0.0, 0.0, 2.0], [1e-4, 0.0, 2.0], [0.0, 1e-4, 2.0]]), np.array([[0, 1, 2]]))
    P, T = side_by_side((V, F), speck)
    P = np.concatenate([P, [[2.0, 0.0, 0.0]]])
    label = patch_labels(P, T, 50)
    assert (label >= 0).all()
    seeds_near = [label[np.argmin(np.linalg.norm(V - P[i], axis=1))] for i in (len(V), len(P) - 1)]
    assert label[len(V)] == label[len(V) + 1] == label[len(V) + 2]
    centres = np.array([P[: len(V)][label[: len(V)] == k].mean(axis=0) for k in seeds_near])
    assert np.linalg.norm(centres[0] - (0, 0, 1)) < 0.5
    assert np.linalg.norm(centres[1] - (1, 0, 0)) < 0.5


@pytest.mark.parametrize("name", SHAPES)
def test_rounding_errors_decide_nothing_on_regular_meshes(name, monkeypatch) -> None:
    """Another library or processor must find the patches of a mark again."""
    label = patch_labels(*SHAPES[name], 200)
    rng = np.random.default_rng(0)
    for function in (vertex_areas, lengths):

        def inexact(*arguments, function=function) -> np.ndarray:
            value = function(*arguments)
            return value * (1.0 + 1e-14 * rng.normal(size=value.shape))

        monkeypatch.setattr(patches, function.__name__, inexact)
    for _ in range(3):
        np.testing.assert_array_equal(patch_labels(*SHAPES[name], 200), label)
