"""Whole informed benchmarks in small: both layers, a crowd, what cannot be placed, controls."""

from __future__ import annotations

import json
import sys
from itertools import combinations
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

import meshmark
from meshmark.benchmarking import benchmark as module
from meshmark.benchmarking.benchmark import benchmark_key, run_benchmark
from meshmark.benchmarking.report_command import command_of
from meshmark.benchmarking.report_tables import page_of
from meshmark.benchmarking.subjects import select_frames
from meshmark.benchmarking.suite_rows import Cell, cell_from_text, collusion
from meshmark.benchmarking.suites import Suite
from meshmark.cli import main
from meshmark.demo.build import write_creature
from meshmark.extension.recipe import Recipe, default_layers, layers_from_text
from meshmark.mesh.asset import Asset
from meshmark.sources.writing import write
from meshmark.testing.meshes import icosphere
from meshmark.testing.schemas import schema_folder

# Whole benchmarks: copies for several recipients, each attacked, placed and read.
pytestmark = pytest.mark.slow

FRAMES = "2:2"
SUITE = Suite(
    "tiny",
    (
        Cell("none", {}, "animation", "no attack", "none"),
        Cell("similarity", {"per": "animation"}, "animation", "similarity", "similarity"),
        *collusion("mean", 2),
        cell_from_text("nonsense"),
    ),
)


@pytest.fixture(scope="module")
def source(tmp_path_factory) -> Path:
    return write_creature(tmp_path_factory.mktemp("asset") / "small.usdc", points=3000, frames=2)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("bench")


@pytest.fixture(scope="module")
def document(source, folder) -> dict[str, Any]:
    return run_benchmark(
        [str(source)], SUITE, default_layers(), folder, informed=True, frames=FRAMES
    )


def row_of(document: dict[str, Any], label: str) -> dict[str, Any]:
    [row] = [row for row in document["rows"] if row["label"] == label]
    return row


def test_the_report_keeps_to_its_schema(document) -> None:
    schema = json.loads((schema_folder("json") / "benchmark.schema.json").read_text())
    jsonschema.validate(document, schema)
    assert {row["scheme"] for row in document["rows"]} == {"apex + relief"}


def test_owner_and_recipient_are_found_beside_the_original(document) -> None:
    for label in ("no attack", "similarity"):
        row = row_of(document, label)
        facts = row["informed"]
        assert row["verified"] is True
        assert facts["owner"] < -6
        assert facts["recipient"] < -6
        assert row["log10_p"] == pytest.approx(
            min(facts["owner"], facts["recipient"]) + np.log10(2)
        )
        assert facts["recipients_found"] == facts["recipients"] == 1
        assert facts["covered"] > 0.99
        assert facts["innocent"] is None


def marked_file(folder: Path, kind: str, recipient: str | None = None) -> Path:
    """Find a marked file by what its description in the folder says."""
    told = [json.loads(path.read_text()) for path in (folder / "cells").iterdir()]
    [name] = [
        each["file"]
        for each in told
        if each["identity"]["kind"] == kind and each["identity"].get("recipient") == recipient
    ]
    return folder / "marked" / name


def chosen(path: Path) -> Asset:
    """Read the frames that the benchmark is about."""
    return select_frames(meshmark.read(path), FRAMES)


def test_the_row_says_what_verify_says(document, source, folder) -> None:
    verdict = meshmark.verify(
        chosen(marked_file(folder, "copy", "copy 1")),
        benchmark_key(0),
        recipes=default_layers()[1:],
        recipients=["copy 1"],
        original=chosen(source),
        master=chosen(marked_file(folder, "master")),
    )
    assert verdict.log10_p == pytest.approx(row_of(document, "no attack")["log10_p"])


def test_unmarked_copies_are_placed_and_not_found(document) -> None:
    for row in document["rows"]:
        assert row["control"]["verified"] is False
    facts = row_of(document, "similarity")["control"]["informed"]
    assert facts["covered"] > 0.99
    assert facts["owner"] > -3
    assert facts["recipient"] > -3


def test_random_keys_are_tried_on_both_sides(document) -> None:
    for row in document["rows"]:
        if row["error"]:
            continue
        for facts in (row["informed"], row["control"]["informed"]):
            wrong = facts["wrong_keys"]
            assert wrong["tried"] == 1000
            assert wrong["lowest"] < 0
            for share, count in wrong["at_most"].items():
                assert count <= 1000 * float(share)


def test_both_of_a_crowd_are_found_and_nobody_else(document) -> None:
    row = row_of(document, "collusion of 2, mean")
    facts = row["informed"]
    assert facts["recipients_found"] == facts["recipients"] == 2
    assert facts["innocents"] == 20_000
    assert -6 < facts["innocent"] < 0
    assert facts["blind_owner"] < -3
    control = row["control"]["informed"]
    assert control["recipients_found"] == 0
    assert control["blind_owner"] > -3


def test_the_master_is_made_once_and_copies_differ_little_from_it(document, folder) -> None:
    assert len(list((folder / "marked").iterdir())) == 3
    names = [("master", None), ("copy", "copy 1"), ("copy", "copy 2")]
    meshes = [chosen(marked_file(folder, *name)).meshes[0] for name in names]
    for one, two in combinations(meshes, 2):
        extent = np.ptp(one[0].points)
        assert 0 < np.abs(one[0].points - two[0].points).max() < 1e-2 * extent


def test_what_cannot_run_says_so(document) -> None:
    row = row_of(document, "nonsense")
    assert "known are" in row["error"]
    assert row["informed"] is None
    assert row["verified"] is False


def test_the_page_has_every_row(document) -> None:
    page = page_of(document)
    assert "| no attack | animation |" in page
    assert "| collusion of 2, mean | 2 of 2 |" in page
    assert "0 of 3 unmarked copies found" in page
    assert f"$ {command_of(document)}" in page


def test_the_command_asks_for_the_same_layers_again(document) -> None:
    assert "--informed --scheme apex --scheme relief" in command_of(document)
    assert "max_mrms" not in command_of(document)
    schemes = [recipe.as_json() for recipe in layers_from_text(["apex", "relief"])]
    assert schemes == document["schemes"]


def test_a_second_run_marks_nothing_again(document, source, folder, monkeypatch) -> None:
    def embed_again(*args: Any, **options: Any) -> None:
        raise AssertionError("marked again")

    monkeypatch.setattr(module, "make_master", embed_again)
    monkeypatch.setattr(module, "make_recipients_copy", embed_again)
    again = run_benchmark(
        [str(source)], SUITE, default_layers(), folder, informed=True, frames=FRAMES
    )
    assert again["rows"] == document["rows"]


def test_a_ball_that_no_blind_layer_can_mark_still_has_its_relief(tmp_path) -> None:
    V, F = icosphere(3)
    still = meshmark.MeshAnimation.from_arrays(V * [1.0, 0.8, 0.6], F, prim="/Ball")
    asset = Asset("ball", (still,), "memory")
    write(asset, asset, tmp_path / "ball.usdc")
    suite = Suite("tiny", SUITE.cells[:1])
    for layers in (default_layers(), (Recipe("relief"),)):
        made = run_benchmark(
            [str(tmp_path / "ball.usdc")], suite, layers, tmp_path / "out", informed=True
        )
        [row] = made["rows"]
        assert row["error"] is None
        assert row["verified"] is True
        assert row["control"]["verified"] is False


def test_schemes_that_do_not_fit_are_refused(source, tmp_path, monkeypatch, capsys) -> None:
    command = ["meshmark", "bench", str(source), "--suite", "leaks", "-o", str(tmp_path / "out")]
    for options in (["--informed", "--scheme", "apex"], ["--scheme", "relief"]):
        monkeypatch.setattr(sys, "argv", [*command, *options])
        with pytest.raises(SystemExit) as stop:
            main()
        assert stop.value.code == 2
    assert "relief needs --informed" in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out").exists()
