"""An asset of several meshes has one verdict, however a leak has joined or split them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import meshmark
from folders import FAULTS
from meshmark import Key, verify
from meshmark.alignment.pieces import joined
from meshmark.detection.verdict import Verdict
from meshmark.embedding.asset import MarkedAsset, embed
from meshmark.extension.recipe import Recipe
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.testing.meshes import icosphere

KEY, OTHER = Key(bytes(range(32))), Key(bytes(range(1, 33)))
RELIEF = [Recipe("relief")]


def asset(*meshes: MeshAnimation) -> Asset:
    return Asset("balls", meshes, "memory")


def ball(n: int, level: int = 2) -> MeshAnimation:
    V, F = icosphere(level)
    at = np.random.default_rng(n).uniform(-8, 8, 3)
    return MeshAnimation.from_arrays((1.0 + 0.1 * n) * V + at, F, prim=f"/ball_{n}")


@pytest.fixture(scope="module")
def marked() -> MarkedAsset:
    """Five balls, and a crumb too small for a mark."""
    balls = [ball(n) for n in range(5)]
    return embed(asset(*balls, ball(9, level=0)), KEY, recipe=RELIEF)


def noisy(mesh: MeshAnimation, share: float) -> MeshAnimation:
    size = share * np.linalg.norm(np.ptp(mesh[0].points, axis=0))
    rng = np.random.default_rng(int(mesh.prim[-1]))
    return mesh.map(lambda frame: frame.moved(frame.points + size * rng.normal(size=(162, 3))))


def united(meshes) -> MeshAnimation:
    whole = joined(meshes)
    assert whole is not None
    return replace(whole, prim="/joined")


def beside(marked: MarkedAsset, *meshes: MeshAnimation, key: Key = KEY) -> Verdict:
    return verify(asset(*meshes), key, recipes=RELIEF, original=marked.original)


@pytest.mark.slow
def test_all_meshes_are_marked_but_what_is_too_small(marked) -> None:
    assert [mesh.original.prim for mesh in marked.meshes] == [f"/ball_{n}" for n in range(5)]
    [crumb] = marked.skipped
    assert crumb.prim == "/ball_9"
    crumbs = marked.original.mesh("/ball_9")
    verdict = beside(marked, *marked.asset.meshes, crumbs)
    assert verdict.verdict == "marked"
    assert [(each.scheme, each.meshes) for each in verdict.pooled] == [("relief", 5)]
    assert beside(marked, *marked.asset.meshes, crumbs, key=OTHER).verdict == "not marked"


@pytest.mark.slow
def test_balls_that_say_too_little_each_say_it_together_though_they_were_joined(marked) -> None:
    verdict = beside(marked, united([noisy(mesh, 1e-4) for mesh in marked.asset.meshes]))
    assert verdict.verdict == "marked"
    [together] = verdict.pooled
    assert (together.meshes, together.log10_p) == (5, verdict.log10_p)
    [best] = verdict.prims
    assert (best.prim, best.verdict) == ("/joined", "not marked")
    assert best.log10_p > together.log10_p + 3.0


@pytest.mark.slow
def test_balls_without_a_mark_say_nothing_together(marked) -> None:
    bare = [noisy(mesh, 1e-4) for mesh in marked.original.meshes[:5]]
    for meshes in (bare, [united(bare)]):
        verdict = beside(marked, *meshes)
        assert (verdict.verdict, verdict.pooled[0].meshes) == ("not marked", 5)
        assert verdict.log10_p > -2.0


@pytest.mark.slow
def test_a_leak_that_joined_all_meshes_is_marked_alike(marked) -> None:
    alone = beside(marked, *marked.asset.meshes)
    found = beside(marked, united(marked.asset.meshes))
    assert found.log10_p == pytest.approx(alone.log10_p)
    assert found.pooled[0].meshes == 5
    assert [prim.prim for prim in found.prims] == ["/joined"]


@pytest.mark.slow
def test_a_leak_that_split_all_meshes_is_marked_alike(marked) -> None:
    alone = beside(marked, *marked.asset.meshes)
    halves = []
    for mesh in marked.asset.meshes:
        V, F = mesh[0].points, mesh[0].faces
        low = V[F].mean(axis=1)[:, 2] < V[:, 2].mean()
        for n, side in enumerate((low, ~low)):
            used, local = np.unique(F[side], return_inverse=True)
            halves.append(
                MeshAnimation.from_arrays(V[used], local.reshape(-1, 3), prim=f"{mesh.prim}_{n}")
            )
    found = beside(marked, *halves)
    assert found.pooled[0].meshes == 5
    assert found.log10_p < 0.8 * alone.log10_p


@pytest.mark.slow
def test_bodies_that_were_joined_are_found_blindly_and_judged_together() -> None:
    two = meshmark.read(FAULTS / "two-recipients/two_meshes.usdc")
    key = Key.load(FAULTS / "test.key")
    names = ["acme", "globex"]
    found = verify(
        asset(united(two.meshes)), key, recipes=[Recipe("apex")], recipients=names, frames="auto"
    )
    assert found.verdict == "marked"
    assert {named.recipient for named in found.recipients} == set(names)
    assert [(each.scheme, each.meshes) for each in found.pooled] == [("apex", 2)]
