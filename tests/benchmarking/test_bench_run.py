"""Whole benchmarks in small: marked and unmarked, failing cells, resuming, sameness."""

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
from meshmark.benchmarking.benchmark import run_benchmark
from meshmark.benchmarking.suite_rows import Cell, cell_from_text
from meshmark.benchmarking.suites import SUITES, Suite
from meshmark.cli import main
from meshmark.demo.build import write_creature
from meshmark.errors import InputError, UsageError
from meshmark.extension.recipe import Recipe
from meshmark.mesh.asset import Asset
from meshmark.sources.writing import write
from meshmark.testing.meshes import dumbbell
from meshmark.testing.schemas import schema_folder

SUITE = Suite(
    "tiny",
    (
        Cell("none", {}, "animation", "no attack", "none"),
        Cell("noise", {"amplitude": 0.0005, "per": "frame"}, "frame", "noise 0.05 %", "noise"),
        Cell(
            "collusion", {"kind": "alternate"}, "animation", "alternate", "collusion", "all",
            1,
        ),
        Cell("collusion", {"kind": "median"}, "animation", "median", "collusion", "all", 2),
        cell_from_text("cropping:share=1.0"),
        cell_from_text("nonsense"),
        cell_from_text("combination:attacks=cropping:share=0.995"),
    ),
)  # fmt: skip


@pytest.fixture(scope="module")
def source(tmp_path_factory) -> Path:
    return write_creature(tmp_path_factory.mktemp("asset") / "small.usdc", points=3000, frames=2)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("bench")


@pytest.fixture(scope="module")
def document(source, folder) -> dict[str, Any]:
    return run_benchmark([str(source)], SUITE, [Recipe("tsai2014")], folder)


def row_of(document: dict[str, Any], label: str) -> dict[str, Any]:
    [row] = [row for row in document["rows"] if row["label"] == label]
    return row


def test_the_report_keeps_to_its_schema(document) -> None:
    schema = json.loads((schema_folder("json") / "benchmark.schema.json").read_text())
    jsonschema.validate(document, schema)
    assert [row["attack"] for row in document["rows"]] == [cell.attack for cell in SUITE.cells]


def test_a_copy_left_alone_is_found_and_an_unmarked_one_is_not(document) -> None:
    row = row_of(document, "no attack")
    assert row["verified"] is True
    assert row["log10_p"] < -6
    assert row["ber_max"] <= 0.0625
    assert row["control"]["verified"] is False
    assert row["control"]["log10_p"] > -3
    assert row["control"]["ber_avg"] > row["ber_avg"]


def test_what_the_attacks_did_is_told(document) -> None:
    did = {row["label"]: row["attack_mrms_rel"] for row in document["rows"] if not row["error"]}
    assert did.pop("no attack") < 1e-6
    assert all(mrms > 1e-6 for mrms in did.values())


def test_attacks_really_happen_on_both_sides(document) -> None:
    alone, noisy = row_of(document, "no attack"), row_of(document, "noise 0.05 %")
    assert noisy["log10_p"] != alone["log10_p"]
    assert noisy["control"]["ber_avg"] != alone["control"]["ber_avg"]


def test_colluders_differ(document) -> None:
    alone, alternate = row_of(document, "no attack"), row_of(document, "alternate")
    # Every other frame is another recipient's: pooling ends, and single frames have to do.
    assert alternate["error"] is None
    assert alone["log10_p"] + 0.5 < alternate["log10_p"] < -6.0
    assert alternate["control"]["ber_avg"] == alone["control"]["ber_avg"]


def test_a_crowd_has_as_many_different_copies_as_its_attack_needs(document, folder) -> None:
    copies = [meshmark.read(path).meshes[0][0].points for path in (folder / "marked").iterdir()]
    assert len(copies) == 3
    assert all(np.any(one != two) for one, two in combinations(copies, 2))
    alone, median = row_of(document, "no attack"), row_of(document, "median")
    assert median["error"] is None
    assert median["attack_mrms_rel"] > 1e-6
    assert median["log10_p"] > alone["log10_p"]
    assert median["control"]["ber_avg"] == alone["control"]["ber_avg"]


def test_cells_that_cannot_run_say_why_and_the_others_go_on(document) -> None:
    assert "share is 1.0" in row_of(document, "cropping:share=1.0")["error"]
    unknown = row_of(document, "nonsense")
    assert "known are: bending, collusion" in unknown["error"]
    assert unknown["plugin_failed"] is False
    assert unknown["control"]["error"] == unknown["error"]
    [nothing] = [row for row in document["rows"] if row["attack"] == "combination"]
    # What is left of the mesh holds nothing; that is an answer, or a reason, never a crash.
    assert nothing["verified"] is False
    assert nothing["error"] or nothing["notes"]


def test_distortion_has_every_measure(document) -> None:
    [row] = document["distortion"]
    assert 0 < row["mrms_rel"] < row["hausdorff_rel"] < 0.01
    assert row["flipped_faces"] == 0
    assert row["error"] is None


@pytest.mark.slow
def test_a_row_can_be_repeated_by_hand(document, folder, tmp_path, monkeypatch, capsys) -> None:
    row = row_of(document, "noise 0.05 %")
    [copy] = [path for path in (folder / "marked").iterdir() if is_the_owners(path, document)]
    run(
        monkeypatch, "attack", "noise", copy, "-o", tmp_path / "leaked.usdc",
        "-p", "amplitude=0.0005", "-p", "per=frame", "--seed", row["seed"],
    )  # fmt: skip
    key = folder / "benchmark-0.key"
    capsys.readouterr()
    run(
        monkeypatch, "verify", tmp_path / "leaked.usdc", "--key", key, "--scheme", "tsai2014",
        "--frames", ":", "--json",
    )  # fmt: skip
    [asset] = json.loads(capsys.readouterr().out)["assets"]
    assert asset["log10_p"] == row["log10_p"]
    assert asset["prims"][0]["ber"] == {"avg": row["ber_avg"], "max": row["ber_max"]}


def is_the_owners(path: Path, document: dict[str, Any]) -> bool:
    key = module.benchmark_key(0)
    verdict = meshmark.verify(meshmark.read(path), key, recipes=[Recipe("tsai2014")])
    return bool(verdict.log10_p == row_of(document, "no attack")["log10_p"])


def run(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["meshmark", *map(str, arguments)])
    monkeypatch.setenv("MESHMARK_JOBS", "1")
    try:
        main()
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


def test_a_second_run_does_only_what_is_missing(document, source, folder, monkeypatch) -> None:
    performed = []
    perform = module.perform

    def counted(order: Any) -> None:
        performed.append(order.task.cell.label)
        perform(order)

    def embed_again(*args: Any, **options: Any) -> None:
        raise AssertionError("marked again")

    monkeypatch.setattr(module, "perform", counted)
    monkeypatch.setattr(module, "make_copy", embed_again)
    [victim] = [
        path
        for path in (folder / "cells").glob("*.json")
        if is_cell(json.loads(path.read_text())["identity"], "noise", "control")
    ]
    victim.unlink()
    again = run_benchmark([str(source)], SUITE, [Recipe("tsai2014")], folder)
    failed = {row["label"] for row in document["rows"] if row["error"]}
    assert set(performed) == {"noise 0.05 %"} | failed
    assert performed.count("noise 0.05 %") == 1
    for report in (document, again):
        assert set(report["timings"]) == {"elapsed_s", "assets", "rows"}
    assert without_timings(again) == without_timings(document)


def test_a_result_that_never_came_is_told(source, folder, document, monkeypatch) -> None:
    monkeypatch.setattr(module, "perform", lambda order: None)
    suite = Suite("tiny", (cell_from_text("float16"),))
    [row] = run_benchmark([str(source)], suite, [Recipe("tsai2014")], folder)["rows"]
    assert "gone" in row["error"]


def is_cell(identity: dict[str, Any], attack: str, side: str) -> bool:
    return identity.get("attack") == attack and identity.get("side") == side


def without_timings(document: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in document.items() if name != "timings"}


@pytest.mark.slow
def test_two_runs_are_the_same_and_another_seed_is_not(document, source, tmp_path) -> None:
    short = Suite("tiny", SUITE.cells[:2])
    one = run_benchmark([str(source)], short, [Recipe("tsai2014")], tmp_path / "one")
    assert one["rows"] == [
        row for row in document["rows"] if row["label"] in ("no attack", "noise 0.05 %")
    ]
    two = run_benchmark([str(source)], short, [Recipe("tsai2014")], tmp_path / "two", seed=1)
    assert one["key_id"] != two["key_id"]
    assert one["rows"][1]["seed"] != two["rows"][1]["seed"]
    assert one["rows"][1]["log10_p"] != two["rows"][1]["log10_p"]


def test_an_asset_that_cannot_be_marked_is_told_in_its_rows(source, folder, tmp_path) -> None:
    V, F = dumbbell(n_around=6, n_along=8)
    still = meshmark.MeshAnimation.from_arrays(V, F, prim="/Blob")
    asset = Asset("blob", (still,), "memory")
    write(asset, asset, tmp_path / "blob.usdc")
    suite = Suite("tiny", SUITE.cells[:1])
    made = run_benchmark(
        [str(tmp_path / "blob.usdc"), str(source)], suite, [Recipe("tsai2014")], folder
    )
    blob, small = made["rows"]
    assert "can hold 16 bits" in blob["error"]
    assert small["error"] is None
    assert [row["error"] is None for row in made["distortion"]] == [False, True]


def test_bad_sources_and_ranges_are_refused_before_any_work(source, tmp_path) -> None:
    with pytest.raises(InputError):
        run_benchmark([str(tmp_path / "no.usda")], SUITE, [Recipe("tsai2014")], tmp_path / "out")
    with pytest.raises(UsageError):
        run_benchmark([str(source)], SUITE, [Recipe("tsai2014")], tmp_path / "out", frames="7:9")
    assert not (tmp_path / "out").exists()


def of_one_frame(source, folder) -> list[object]:
    """Ask for the first frame's report by the shortened suite."""
    choice = ("--suite", "tsai2014", "--scheme", "tsai2014", "--frames", "1:1")
    return ["bench", source, *choice, "-o", folder]


@pytest.mark.slow
def test_the_command_writes_a_report_and_tells_by_its_exit_code(
    source, tmp_path, monkeypatch, capsys
) -> None:
    monkeypatch.setitem(SUITES, "tsai2014", Suite("tsai2014", SUITE.cells[:2]))
    command = of_one_frame(source, tmp_path / "b")
    assert run(monkeypatch, *command) == 0
    report = json.loads((tmp_path / "b" / "report.json").read_text())
    assert "| no attack | animation |" in (tmp_path / "b" / "report.md").read_text()
    capsys.readouterr()
    failing = [*command, "--attack", "cropping:share=1", "--json"]
    assert run(monkeypatch, *failing) == 1
    out, err = capsys.readouterr()
    printed = json.loads(out)
    assert printed["rows"][:2] == report["rows"]
    assert "share is 1" in err
    assert run(monkeypatch, "bench", source, "--suite", "none", "-o", tmp_path / "c") == 2
    assert not (tmp_path / "c").exists()


@pytest.mark.slow
def test_without_matplotlib_all_else_is_written(source, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setattr("meshmark.benchmarking.plots.find_spec", lambda name: None)
    monkeypatch.setitem(SUITES, "tsai2014", Suite("tsai2014", SUITE.cells[:1]))
    command = of_one_frame(source, tmp_path)
    assert run(monkeypatch, *command) == 0
    assert "meshmark[plots]" in capsys.readouterr().err
    assert (tmp_path / "report.md").exists()
    assert not list(tmp_path.glob("*.png"))


@pytest.mark.slow
def test_the_suite_on_a_real_horse(data_folder, tmp_path) -> None:
    source = data_folder / "horse-gallop.usdc"
    made = run_benchmark(
        [str(source)], SUITES["tsai2014"], [Recipe("tsai2014")], tmp_path, frames="1:17:8", jobs=2
    )
    assert all(row["error"] is None for row in made["rows"])
    assert not any(row["control"]["verified"] for row in made["rows"])
    assert row_of(made, "no attack")["verified"] is True
    compared = [row for row in made["rows"] if row["paper"] is not None]
    assert len(compared) == len(made["rows"]) - 1
    light = [row for row in compared if row["attack"] in ("noise", "quantization", "similarity")]
    assert all(row["verified"] for row in light)
