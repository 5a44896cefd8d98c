"""Copies made of single vertices of several: whose they are, and whose not."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.mesh.animation import Frame
from meshmark.mesh.topology import Topology
from meshmark.statistics.decoys import log_e_among_decoys
from meshmark.testing.meshes import icosphere, plane, side_by_side, torus
from meshmark_plugins.schemes.relief.basis import BLOCK, Basis
from meshmark_plugins.schemes.relief.blocks import blocks
from meshmark_plugins.schemes.relief.scheme import MOST_STEPS, STEPS, Relief

SHAPES = {
    "sphere": icosphere(3),
    "torus": torus(48, 20),
    "plane": plane(24),
    "two": side_by_side(icosphere(2), (icosphere(2)[0] + (3.0, 0.0, 0.0), icosphere(2)[1])),
}
COPIES = 5
# Log10 e-values: of whoever gave vertices at least, of others at most.
FOUND, CHANCE = 8.0, 2.0


@pytest.mark.parametrize("shape", SHAPES)
def test_blocks_add_up_to_the_heights_of_the_finest_level(shape) -> None:
    basis = Basis.of(*SHAPES[shape])
    fine = basis.levels[-1].n_chips
    w = np.random.default_rng(0).choice((-1.0, 1.0), basis.n_chips)
    w[:-fine] = 0.0
    n = len(SHAPES[shape][0])
    found, chips = np.zeros(n), []
    for block in blocks(basis, np.arange(n)):
        found[block.rows] += block.heights @ w[block.chips]
        chips += list(range(basis.n_chips))[block.chips]
        assert block.heights.shape == (len(block.rows), len(range(basis.n_chips)[block.chips]))
        assert block.heights.shape[1] <= BLOCK
    assert chips == list(range(basis.n_chips - fine, basis.n_chips))
    assert np.sqrt(np.mean((found - basis.heights(w)) ** 2)) < 0.03


def test_blocks_at_some_vertices_are_those_of_all() -> None:
    basis = Basis.of(*SHAPES["torus"])
    some = np.arange(0, len(SHAPES["torus"][0]), 3)
    every = list(blocks(basis, np.arange(len(SHAPES["torus"][0]))))
    for one, whole in zip(blocks(basis, some), every, strict=True):
        np.testing.assert_array_equal(some[one.rows], whole.rows[whole.rows % 3 == 0])
        np.testing.assert_array_equal(one.heights, whole.heights[whole.rows % 3 == 0])


@pytest.fixture(scope="module")
def scene():
    """A ball; chips of five recipients' copies, then of five others'; decoys; their heights."""
    V, F = icosphere(4)
    scheme = Relief()
    layout = scheme.layout(Frame(1.0, V, Topology.from_triangles(F, len(V))))
    rng = np.random.default_rng(1)
    signs = rng.choice((-1, 1), (2 * COPIES, layout.n_chips))
    signs[:, layout.owner] = signs[0, layout.owner]
    decoys = rng.choice((-1, 1), (31, layout.n_chips))
    return scheme, layout, signs, decoys, layout.basis.heights(signs[:COPIES].T.astype(float))


def blended(heights, kind):
    rng = np.random.default_rng(2)
    if kind == "choice":
        return heights[np.arange(len(heights)), rng.integers(COPIES, size=len(heights))]
    low, high = heights.min(axis=1), heights.max(axis=1)
    drawn = np.where(rng.integers(2, size=len(low)) == 1, high, low)
    return {"min": low, "max": high, "extremes": drawn}[kind]


def log10_e(scene, y):
    scheme, layout, signs, decoys, _ = scene
    steps = np.where(np.isnan(y), -MOST_STEPS - 1, np.rint(STEPS * y)).astype(np.int16)
    return log_e_among_decoys(scheme.vertex_fits(steps, layout, signs, decoys)) / np.log(10.0)


@pytest.mark.parametrize("kind", ["min", "max", "choice", "extremes"])
def test_all_who_gave_vertices_are_found_and_nobody_else(scene, kind) -> None:
    e = log10_e(scene, blended(scene[-1], kind))
    assert e[:COPIES].min() > FOUND
    assert e[COPIES:].max() < CHANCE


def test_they_are_found_through_noise_and_where_vertices_are_missing(scene) -> None:
    y = blended(scene[-1], "choice")
    y = y + 0.05 * np.random.default_rng(3).normal(size=len(y))
    y[::5] = np.nan
    e = log10_e(scene, y)
    assert e[:COPIES].min() > FOUND
    assert e[COPIES:].max() < CHANCE


@pytest.mark.parametrize("y", [np.nan, 0.0, 32.0])
def test_heights_that_tell_nothing_find_nobody(scene, y) -> None:
    n = len(scene[1].vertices)
    assert log10_e(scene, np.full(n, y)).max() < CHANCE


def test_heights_of_another_number_of_vertices_tell_nothing(scene) -> None:
    """An evidence file that is not authentic may hold anything."""
    np.testing.assert_array_equal(log10_e(scene, np.zeros(7)), 0.0)


def test_a_part_does_not_depend_on_chips_that_come_later(scene) -> None:
    """What makes the fits e-values: block b sees the chips before it and its own."""
    scheme, layout, signs, decoys, heights = scene
    steps = np.rint(STEPS * blended(heights, "min")).astype(np.int16)
    fits = scheme.vertex_fits(steps, layout, signs[:1], decoys)
    for b in (0, len(layout.blocks) // 2):
        later = signs[:1].copy()
        later[:, layout.blocks[b].chips.stop :][
            :, ~layout.owner[layout.blocks[b].chips.stop :]
        ] *= -1
        changed = scheme.vertex_fits(steps, layout, later, decoys)
        np.testing.assert_array_equal(changed[: b + 1], fits[: b + 1])
        assert np.any(changed[b + 1] != fits[b + 1])
