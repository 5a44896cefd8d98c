"""Balls, sheets and low characters: what holds no blind mark is found beside its original."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from meshmark import Key, read, verify
from meshmark.commands.attack import attack_asset
from meshmark.delivery.unmarked import split_fit
from meshmark.embedding.asset import MarkedAsset, embed
from meshmark.extension.recipe import Recipe
from meshmark.extension.registry import make_attack
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset, as_asset
from meshmark.testing.meshes import icosphere, plane

pytestmark = pytest.mark.slow

KEY = Key(bytes(range(32)))
RELIEF = [Recipe("relief")]
TARGET = -6.0


def sheet(_: Path) -> Asset:
    return as_asset(MeshAnimation.from_arrays(*plane(50), prim="/Sheet"))


def eye(_: Path) -> Asset:
    V, F = icosphere(4)
    return as_asset(MeshAnimation.from_arrays(V * (1.0, 0.95, 0.9), F, prim="/Eye"))


def stored(name: str) -> Callable[[Path], Asset]:
    return lambda folder: split_fit(read(folder / "usd" / name))


SUBJECTS = {
    "sphere": stored("points-sphere.usda"),
    "ball": stored("ballset/StandaloneScene/Ball_payload.usd"),
    "human": stored("skel-human.usda"),
    "sheet": sheet,
    "eye": eye,
}
ATTACKS = {
    "similarity": make_attack("similarity"),
    "noise": make_attack("noise", amplitude=0.0005),
    "cropping": make_attack("cropping", share=0.3),
    "simplification": make_attack("simplification", ratio=0.3),
}
# A rest of a ball or of an ellipsoid fits in many places equally well, and a rest of a flat sheet
# everywhere: nothing but the relief itself tells where it was. A right guess is luck.
AMBIGUOUS = {
    ("sphere", "cropping"),
    ("sphere", "simplification"),
    ("ball", "cropping"),
    ("ball", "simplification"),
    ("sheet", "cropping"),
    ("sheet", "simplification"),
    ("eye", "cropping"),
    ("eye", "simplification"),
}


@pytest.fixture(scope="module", params=SUBJECTS)
def subject(request, data_folder) -> tuple[str, Asset, MarkedAsset]:
    original = SUBJECTS[request.param](data_folder)
    return request.param, original, embed(original, KEY, recipe=RELIEF)


def test_every_mesh_is_marked(subject) -> None:
    _, original, marked = subject
    assert marked.skipped == ()
    assert verify(marked.asset, KEY, recipes=RELIEF, original=original).log10_p <= TARGET


@pytest.mark.parametrize("attack", ATTACKS)
def test_a_copy_is_found_or_fits_in_several_places(subject, attack) -> None:
    name, original, marked = subject
    copy = attack_asset(marked.asset, ATTACKS[attack], 0)
    found = verify(copy, KEY, recipes=RELIEF, original=original)
    if (name, attack) in AMBIGUOUS:
        assert found.verdict in ("marked", "inconclusive")
        assert found.verdict == "marked" or found.notes
    else:
        assert found.log10_p <= TARGET
        other = verify(copy, Key(bytes(range(1, 33))), recipes=RELIEF, original=original)
        assert other.log10_p > -3.0


@pytest.mark.parametrize("seed", [1, 2])
def test_no_rest_that_fits_in_several_places_passes_for_unmarked(subject, seed) -> None:
    name, original, marked = subject
    if (name, "cropping") not in AMBIGUOUS:
        pytest.skip("its rest fits in one place only")
    copy = attack_asset(marked.asset, ATTACKS["cropping"], seed)
    found = verify(copy, KEY, recipes=RELIEF, original=original)
    assert found.verdict in ("marked", "inconclusive")
