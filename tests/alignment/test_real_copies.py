"""Alignment of what attacks make of a galloping horse and a cow."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from alignment_shapes import errors, mapped, similarity
from meshmark.alignment.align import align_mesh
from meshmark.errors import AlignmentError
from meshmark.extension.registry import make_attack
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.closest_points import ClosestPoints
from meshmark.mesh.geometry import surface_box
from meshmark.sources.reading import read

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def cow(data_folder: Path) -> MeshAnimation:
    return read(str(data_folder / "pcow.usdc")).meshes[0]


@pytest.fixture(scope="module")
def horse(data_folder: Path) -> MeshAnimation:
    return read(str(data_folder / "horse-gallop.usdc")).meshes[0]


def attacked(mesh: MeshAnimation, name: str, **parameters: Any) -> MeshAnimation:
    """Attack and move two frames, unless they are all, and keep them in memory."""
    rng = np.random.default_rng(1)
    two = mesh if len(mesh) == 2 else mesh.select([7, 21])
    copy = make_attack(name, **parameters).apply(two, rng)
    A = similarity(5)
    return MeshAnimation.from_frames([frame.moved(mapped(A, frame.points)) for frame in copy])


@pytest.mark.parametrize(
    ("name", "parameters", "method", "bound"),
    [
        ("noise", {"amplitude": 0.005}, "identity", 1e-4),
        ("jitter", {}, "identity", 1e-5),
        ("reorder", {}, "pca", 1e-6),
        ("simplification", {"ratio": 0.9, "per": "frame"}, "pca", 2e-4),
        ("joining", {"thing": "ground"}, "pca", 1e-6),
    ],
)
def test_copies_of_a_cow_are_placed(
    cow: MeshAnimation, name: str, parameters: dict[str, Any], method: str, bound: float
) -> None:
    copy = attacked(cow, name, **parameters)
    found = align_mesh(copy, cow, [0, 1])
    assert found.method == method
    # What the maps of two frames make of the first pose.
    assert errors(found, similarity(5)).max() < bound
    np.testing.assert_allclose([frame.pose for frame in found.frames], [7.0, 21.0], atol=1e-3)


def test_frames_between_those_of_a_fast_gallop_are_found(horse: MeshAnimation) -> None:
    copy = make_attack("speed", factor=1.25).apply(horse, np.random.default_rng(1))
    found = align_mesh(copy, horse, range(0, len(copy), 3))
    # Frames 37 and 38 are far from their blend.
    assert 30 in [frame.index for frame in found.frames]
    assert max(frame.residual for frame in found.frames) < 1e-6


def test_a_bend_is_undone_without_knowing_the_vertices(horse: MeshAnimation) -> None:
    copy = attacked(attacked(horse, "bending", amount=0.01), "reorder")
    [frame] = align_mesh(copy, horse, [0]).frames
    there = horse[7]
    surface = ClosestPoints(there.points, there.faces)
    diagonal, _ = surface_box(there.points, there.faces)
    far = {
        name: np.sqrt((surface.distances(map_(copy[0].points)) ** 2).mean()) / diagonal
        for name, map_ in frame.maps.items()
    }
    assert far["cubic"] < 3e-5 < 1e-3 < far["similarity"]


@pytest.mark.parametrize("share", [0.3, 0.5, 0.8])
def test_cropped_copies_are_placed(horse: MeshAnimation, share: float) -> None:
    found = align_mesh(attacked(horse, "cropping", share=share), horse, [0, 1])
    assert errors(found, similarity(5)).max() < 1e-5


def test_another_animal_is_refused(cow: MeshAnimation, horse: MeshAnimation) -> None:
    with pytest.raises(AlignmentError):
        align_mesh(horse, cow, [0])
