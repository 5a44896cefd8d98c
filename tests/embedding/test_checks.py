"""What is checked of a written file: frames spread over it, and all where the limit is in doubt."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.detection.verdict import Verdict
from meshmark.embedding import checks
from meshmark.embedding.asset import MarkedAsset, MarkedMesh, embed
from meshmark.embedding.checks import (
    FRAMES,
    checked_frames,
    measure_distortion,
    told_of_limit,
    verify_written,
)
from meshmark.embedding.mesh import Embedded
from meshmark.extension.recipe import Recipe, default_layers, mrms_limit, within_mrms
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset, as_asset
from meshmark.testing.informed_schemes import horned
from meshmark.testing.meshes import icosphere

V, F = icosphere(2)
DIAGONAL = 2.0 * np.sqrt(3.0)


def swollen(shares: np.ndarray) -> MarkedMesh:
    """A ball whose frames swell by shares of its diagonal; the first and the last hold no mark."""
    return marked_by(np.repeat(shares[:, None], len(V), axis=1))


def marked_by(shares: np.ndarray) -> MarkedMesh:
    """A ball whose vertices rise by shares (T, N) of its diagonal, between two unmarked frames."""
    still = MeshAnimation.from_arrays(np.stack([V] * (len(shares) + 2)), F)
    radii = 1.0 + DIAGONAL * np.pad(shares, ((1, 1), (0, 0)))
    marked = MeshAnimation.from_arrays(radii[:, :, None] * V, F)
    frames = tuple(range(1, len(shares) + 1))
    return MarkedMesh(still, (Embedded(marked, frames, 1, "relief", informed=True),))


def measured(mesh: MarkedMesh, layers: list[Recipe], *, check_all: bool = False):
    return measure_distortion(mesh, mesh.animation, {}, layers, check_all=check_all, jobs=1)


def test_frames_are_spread_over_the_marked_ones() -> None:
    mesh = swollen(np.full(45, 1e-5))
    some = checked_frames(mesh, check_all=False)
    assert some == (1, 5, 9, 13, 17, 21, 25, 29, 33, 37, 41, 45)
    assert len(some) == FRAMES
    assert checked_frames(mesh, check_all=True) == tuple(range(1, 46))
    assert checked_frames(swollen(np.full(5, 1e-5)), check_all=False) == (1, 2, 3, 4, 5)


def test_few_frames_are_compared_unless_all_are_asked_for() -> None:
    mesh = swollen(np.linspace(1e-5, 3e-5, 25))
    [relief] = layers = [Recipe("relief")]
    assert relief.parameter("max_mrms") > 4e-5
    some, every = measured(mesh, layers), measured(mesh, layers, check_all=True)
    assert (some.compared_frames, every.compared_frames) == (FRAMES, 25)
    assert abs(some.mrms_rel - every.mrms_rel) <= some.mrms_rel_error
    assert every.mrms_rel == pytest.approx(2e-5, rel=0.02)
    assert some.flicker == every.flicker


def test_few_frames_of_a_fine_mesh_are_compared_at_few_points(monkeypatch) -> None:
    monkeypatch.setattr(checks, "SAMPLES", 500)
    mesh = marked_by(1e-5 * np.random.default_rng(0).random((3, len(V))))
    layers = [Recipe("relief")]
    some, every = measured(mesh, layers), measured(mesh, layers, check_all=True)
    assert some.compared_frames == every.compared_frames == 3
    assert some.mrms_rel_error > 3.0 * every.mrms_rel_error
    assert abs(some.mrms_rel - every.mrms_rel) <= 3.0 * some.mrms_rel_error
    # Where that leaves the limit in doubt, at all of them.
    [relief] = [layers[0].with_parameter("max_mrms", 1.001 * every.mrms_rel)]
    assert measured(mesh, [relief]).mrms_rel == every.mrms_rel


def test_all_frames_are_compared_if_the_limit_is_in_doubt() -> None:
    # Vertices that rise and sink by turns leave the surface by less than those of a ball that
    # swells: on average the frames keep to the limit, less surely than three standard errors.
    rng = np.random.default_rng(0)
    signs = np.where(rng.random((25, 1)) < 0.5, 1.0, rng.choice((-1.0, 1.0), (25, len(V))))
    mesh = marked_by(2e-5 * signs)
    every = measured(mesh, [Recipe("relief")], check_all=True)
    [relief] = [Recipe("relief").with_parameter("max_mrms", 1.01 * every.mrms_rel)]
    found = measured(mesh, [relief])
    assert found.compared_frames == 25
    assert told_of_limit(found, [relief]) == []
    strict = [relief.with_parameter("max_mrms", 1e-5)]
    [told] = told_of_limit(measured(mesh, strict), strict)
    assert "beyond the limit of 1.00e-05" in told


def test_the_limit_is_that_of_all_layers_together() -> None:
    layers = within_mrms(default_layers(), 3e-4)
    assert mrms_limit(layers) == pytest.approx(3e-4)
    assert mrms_limit([*layers, Recipe("tsai2014")]) is None


KEY, OTHER = Key(bytes(range(32))), Key(bytes(range(1, 33)))


@pytest.fixture(scope="module")
def relief() -> MarkedAsset:
    return embed(horned(), KEY, recipe=[Recipe("relief")])


def checked(
    written: Asset,
    marked: MarkedAsset,
    key: Key,
    scheme: str = "relief",
    *,
    check_all: bool = False,
) -> Verdict:
    return verify_written(
        written,
        marked,
        key,
        [Recipe(scheme)],
        recipient=None,
        check_all=check_all,
        jobs=1,
        progress=None,
    )


def test_what_was_written_is_read_where_it_stands(relief, monkeypatch) -> None:
    def align(*_: object, **__: object) -> None:
        raise AssertionError("it need not be looked for")

    monkeypatch.setattr("meshmark.detection.informed_pairs.align", align)
    assert checked(relief.asset, relief, KEY).verdict == "marked"


def test_what_was_written_is_looked_for_where_it_says_nothing_there(relief) -> None:
    assert checked(relief.asset, relief, OTHER).verdict == "not marked"
    elsewhere = as_asset(relief.asset.meshes[0].map(lambda f: f.moved(2.0 * f.points + 1.0)))
    assert checked(elsewhere, relief, KEY).verdict == "marked"
    bare = checked(as_asset(horned()), relief, KEY)
    assert bare.verdict == "not marked"


def test_few_frames_are_read_alone_if_they_prove_the_mark(monkeypatch) -> None:
    W, G = icosphere(3)
    grown = np.linspace(1.0, 2.0, 14)[:, None, None] * np.eye(3)[0] + np.array([0.0, 1.0, 1.3])
    moving = MeshAnimation.from_arrays(grown * W, G)
    marked = embed(moving, KEY, recipe=[Recipe("cho2007")])

    def frames(key: Key, **options: bool) -> int:
        [prim] = checked(marked.asset, marked, key, "cho2007", **options).prims
        return len(prim.times)

    assert frames(KEY) < 6
    assert frames(OTHER) == FRAMES
    assert frames(KEY, check_all=True) == 14
    monkeypatch.setattr("meshmark.embedding.checks.PROVEN", -1000.0)
    assert frames(KEY) == FRAMES
