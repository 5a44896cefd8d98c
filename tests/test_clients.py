"""Copies that other programs wrote of a marked creature; `tests/clients` has what made them."""

from __future__ import annotations

import pytest

import meshmark
from folders import TESTS
from meshmark.extension.recipe import Recipe

BLENDER = TESTS / "clients" / "blender"

# Largest log10 p that each must be found with: a decade or so above what was measured.
FOUND = {
    "alembic.usdc": -20,
    "decimate-50.usdc": -8.5,
    "decimate-planar.usdc": -19,
    "displace.usdc": -19,
    "fbx.usdc": -20,
    "gltf.usdc": -20,
    "non-uniform-scale.usdc": -8.5,
    "obj.obj": -20,
    "ply.usdc": -20,
    "smooth-10.usdc": -12,
    "stl.usdc": -20,
    "subdivision.usdc": -12,
    "triangulate.usdc": -19,
    "usd-binary.usdc": -20,
    "usd-package.usdz": -20,
    "usd-text.usda": -20,
    "weld.usdc": -20,
}
# What ends this mark: 80 % of the faces gone, and five full Laplacian steps.
LOST = {"decimate-20.usdc": "inconclusive", "laplacian-5.usdc": "not marked"}


@pytest.fixture(scope="module")
def key() -> meshmark.Key:
    return meshmark.Key.load(TESTS / "faults" / "test.key")


def verdict_on(name, key):
    asset = meshmark.read(BLENDER / name)
    return meshmark.verify(asset, key, recipes=[Recipe("apex")], frames="auto")


def test_every_file_is_tried() -> None:
    assert {path.name for path in BLENDER.iterdir()} == FOUND.keys() | LOST.keys()


@pytest.mark.parametrize("name", FOUND)
def test_what_blender_wrote_is_found(name, key) -> None:
    verdict = verdict_on(name, key)
    assert verdict.verdict == "marked"
    assert verdict.log10_p < FOUND[name]


@pytest.mark.parametrize("name", ["usd-package.usdz", "decimate-50.usdc", "obj.obj"])
def test_no_other_key_finds_anything(name) -> None:
    assert verdict_on(name, meshmark.Key(bytes(32))).verdict == "not marked"


@pytest.mark.parametrize("name", LOST)
def test_what_ended_the_mark_is_known(name, key) -> None:
    assert verdict_on(name, key).verdict == LOST[name]
