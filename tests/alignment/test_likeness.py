"""Copies and parts of them are like their originals, and less like all others."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from marked_studio import rock
from meshmark.alignment.likeness import (
    ORIGINALS,
    Signature,
    hypotheses,
    signature,
    signatures,
    unlikeness,
)
from meshmark.alignment.neighbourhoods import RADII, neighbourhoods
from meshmark.arrays import FloatArray
from meshmark.extension.registry import make_attack
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset, as_asset
from meshmark.mesh.closest_points import sample_surface
from meshmark.testing.meshes import icosphere, plane
from meshmark.workers.pool import one_thread

ROCKS = 8


def slow(value: Any) -> Any:
    return pytest.param(value, marks=pytest.mark.slow)


def attacked(mesh: MeshAnimation, *attacks: tuple[str, dict[str, Any]]) -> Asset:
    for name, parameters in attacks:
        mesh = make_attack(name, **parameters).apply(mesh, np.random.default_rng(1))
    return as_asset(mesh)


@pytest.fixture(scope="module", autouse=True)
def quick() -> Iterator[None]:
    """Small matrices are multiplied by one thread."""
    with one_thread():
        yield


@pytest.fixture(scope="module")
def known() -> list[list[list[Signature]]]:
    return [signatures(as_asset(rock(seed))) for seed in range(ROCKS)]


def order(copy: Asset, known: list[list[list[Signature]]]) -> list[int]:
    mine = hypotheses(copy)
    return np.argsort([unlikeness(mine, each) for each in known]).tolist()


def test_neighbourhoods_on_a_ball_are_caps() -> None:
    V, F = icosphere(5)
    R = 1.0 / np.sqrt(4.0 * np.pi)
    N = sample_surface(V, F, 20_000, np.random.default_rng(0))
    N /= np.linalg.norm(N, axis=1, keepdims=True)
    found = neighbourhoods(R * N, N, 1.0, slice(0, None, 200)).reshape(100, len(RADII), 12)
    for number, radius in enumerate(RADII):
        # Archimedes: a cap within a ball of radius r is as large as a disk of that radius.
        height = radius**2 / (2.0 * R)
        area, above, beside = found[:, number, :3].mean(axis=0)
        assert area == pytest.approx(1.0, rel=0.02)
        assert above == pytest.approx(-height / 2.0 / radius, rel=0.02)
        assert beside < 0.1
        # Normals are directions from the centre: their mean is that of the points.
        np.testing.assert_allclose(found[:, number, 10], 1.0 - height / 2.0 / R, rtol=0.02)
        np.testing.assert_allclose(
            found[:, number, 6:9], found[:, number, 3:6] * radius / R, rtol=1e-3, atol=1e-4
        )


@pytest.mark.parametrize("mirrored", [False, True])
def test_signatures_are_those_of_shapes(mirrored: bool) -> None:
    V, F = rock(1)[0].points, rock(1)[0].faces
    Q, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    Q *= np.sign(np.linalg.det(Q)) * (-1.0 if mirrored else 1.0)
    one, two = (signature(W, F, ORIGINALS) for W in (V, 7.0 * V @ Q + [3.0, 4.0, 5.0]))
    assert one is not None
    assert two is not None
    np.testing.assert_allclose(one.shapes, two.shapes, atol=1e-3)
    spans = [np.linalg.norm(each.places - each.places[0], axis=1) for each in (one, two)]
    np.testing.assert_allclose(*spans, atol=1e-5)


def test_what_has_no_area_is_like_nothing(known: Any) -> None:
    V, F = plane(2)
    for W in (np.zeros_like(V), np.full_like(V, np.nan)):
        assert signature(W, F, ORIGINALS) is None
    point: FloatArray = np.zeros((1, *V.shape))
    nothing = as_asset(MeshAnimation.from_arrays(point, F, prim="/Point"))
    assert unlikeness(hypotheses(nothing), known[0]) == np.inf
    assert unlikeness(hypotheses(as_asset(rock(0))), signatures(nothing)) == np.inf


def test_a_copy_is_its_original_among_others_too(known: Any) -> None:
    mine = hypotheses(as_asset(rock(3)))
    assert unlikeness(mine, known[3]) < 1e-6
    both = Asset("two", (rock(3), rock(5)), "memory")
    assert unlikeness(mine, signatures(both)) < 1e-6
    assert unlikeness(hypotheses(both), known[3]) > 0.1


@pytest.mark.parametrize(
    "attacks",
    [
        [("cropping", {"share": 0.5}), ("noise", {"amplitude": 0.001}), ("similarity", {})],
        slow([("noise", {"amplitude": 0.001})]),
        slow([("simplification", {"ratio": 0.9})]),
        slow([("cropping", {"share": 0.2})]),
    ],
    ids=["half, moved", "noisy", "coarse", "cut"],
)
def test_parts_are_most_like_what_they_were_cut_from(known: Any, attacks: Any) -> None:
    assert order(attacked(rock(7), *attacks), known)[0] == 7


def test_an_animated_copy_is_known_by_one_of_its_poses(known: Any) -> None:
    V, F = rock(4)[0].points, rock(4)[0].faces
    swelling = np.stack([V * (1.0 + 0.1 * k * np.abs(V)) for k in range(4)])
    moving = as_asset(MeshAnimation.from_arrays(swelling, F, prim="/Rock"))
    assert order(moving, known)[0] == 4
