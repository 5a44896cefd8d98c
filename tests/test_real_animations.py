"""The galloping horse, marked and found again: the figures the project promises."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from meshmark import Key, mark_file, read, verify
from meshmark.commands.attack import attack_asset
from meshmark.detection.evidence import Evidence
from meshmark.detection.gathering import gather
from meshmark.detection.significance import log10_p_of
from meshmark.extension.recipe import Recipe
from meshmark.extension.registry import make_attack
from meshmark.workers.ordered_map import default_jobs

pytestmark = pytest.mark.slow

KEY = Key(bytes(range(32)))
# Table 1 of the paper, for the horse; its unit is not said. Ours are shares of the diagonal.
PAPER_HAUSDORFF, PAPER_MRMS = 0.007246, 0.000451


@pytest.fixture(scope="module")
def horse(data_folder) -> Path:
    return data_folder / "horse-gallop.usdc"


@pytest.fixture(scope="module", params=["apex", "tsai2014"])
def recipe(request) -> Recipe:
    return Recipe(request.param)


@pytest.fixture(scope="module")
def marked(horse, recipe, tmp_path_factory):
    """Return the manifest of the marked horse, one cycle of it."""
    output = tmp_path_factory.mktemp("horse") / "out.usda"
    before = hashlib.sha256(horse.read_bytes()).hexdigest()
    manifest = mark_file(horse, output, KEY, recipe=recipe, frames="1:24", jobs=default_jobs())
    assert hashlib.sha256(horse.read_bytes()).hexdigest() == before
    return manifest


@pytest.fixture(scope="module")
def evidence(horse, marked, recipe) -> dict[str, Evidence]:
    sources = {
        "unmarked": horse,
        "marked": marked.path.with_name(marked["output"]),
    }
    return {
        label: gather(
            read(path), recipes=[recipe], frames="1:24:3", restored=False, jobs=default_jobs()
        ).items[0]
        for label, path in sources.items()
    }


def test_the_mark_costs_less_than_the_published_one_and_is_found(marked) -> None:
    [prim] = marked["prims"]
    assert prim["distortion"]["hausdorff_rel"] <= PAPER_HAUSDORFF
    assert prim["distortion"]["mrms_rel"] <= PAPER_MRMS
    assert prim["distortion"]["flipped_faces"] == 0
    assert prim["verification"]["verdict"] == "marked"
    assert prim["verification"]["ber"]["avg"] <= 0.04
    assert prim["verification"]["ber"]["max"] <= 0.1875


def test_apex_costs_half_of_the_published_mark_and_rests_on_the_surface(marked, recipe) -> None:
    if recipe.scheme != "apex":
        pytest.skip("promised of apex alone")
    [prim] = marked["prims"]
    assert prim["distortion"]["mrms_rel"] <= PAPER_MRMS / 2
    assert prim["distortion"]["flicker"] <= 0.15
    assert prim["verification"]["log10_p"] < -15


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("noise", {"amplitude": 0.005}),
        ("smoothing", {"iterations": 30}),
        ("simplification", {"ratio": 0.5, "per": "frame"}),
        ("similarity", {}),
    ],
)
def test_apex_is_found_in_one_attacked_frame(marked, recipe, name, parameters) -> None:
    if recipe.scheme != "apex":
        pytest.skip("promised of apex alone")
    copy = read(marked.path.with_name(marked["output"]))
    first = replace(copy, meshes=(copy.meshes[0].select([4]),))
    frame = attack_asset(first, make_attack(name, **parameters), 7)
    assert verify(frame, KEY, recipes=[recipe]).log10_p < -6


@pytest.mark.parametrize("label", ["unmarked", "marked"])
@pytest.mark.parametrize("shared", [False, True])
def test_a_thousand_wrong_keys_are_found_no_oftener_than_p_says(evidence, label, shared) -> None:
    rng = np.random.default_rng(2014)
    n = 1000
    words = np.array([evidence[label].words(Key(rng.bytes(32)), None) for _ in range(n)])
    words = words[:, :1] if shared else words
    log10_p = log10_p_of(evidence[label], words)
    for alpha in (0.3, 0.1, 0.01, 0.001):
        # Four standard deviations of what chance alone allows.
        allowed = n * alpha + 4 * np.sqrt(n * alpha * (1 - alpha))
        assert np.sum(log10_p <= np.log10(alpha)) <= allowed, alpha
    assert not np.any(log10_p <= -6)


def test_topology_and_unmoved_points_are_those_of_the_source(horse, marked, recipe) -> None:
    before = read(horse).meshes[0]
    after = read(marked.path.with_name(marked["output"])).meshes[0]
    assert np.array_equal(before.times, after.times)
    for index in (0, 11, 23):
        assert before[index].topology.same_as(after[index].topology)
        still = np.all(before[index].points == after[index].points, axis=1)
        assert still.mean() < 0.9
        # apex moves the whole surface a little; the published scheme holds the cuts still.
        assert recipe.scheme == "apex" or still.mean() > 0.05
    np.testing.assert_array_equal(before[30].points, after[30].points)
