"""The report: from results to rows, and from rows to a page that hides nothing worse."""

from __future__ import annotations

import json
from typing import Any

import jsonschema
import numpy as np
import pytest

from meshmark.benchmarking.benchmark import benchmark_key
from meshmark.benchmarking.cells import attack_mrms, describe
from meshmark.benchmarking.plots import can_plot, draw_plots
from meshmark.benchmarking.report_command import command_of
from meshmark.benchmarking.report_document import Outcome, document_of, failures
from meshmark.benchmarking.report_tables import page_of
from meshmark.benchmarking.store import Store
from meshmark.benchmarking.subjects import Subject
from meshmark.benchmarking.suite_rows import Cell, cell_from_text
from meshmark.benchmarking.suites import SUITES, Suite
from meshmark.benchmarking.tasks import Bench, Pairing, cell_seed
from meshmark.cli.bench import exit_code
from meshmark.detection.decision import decide
from meshmark.detection.evidence import Evidence, RestoredVariant
from meshmark.extension.recipe import Recipe
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import as_asset
from meshmark.testing.attacks import sphere
from meshmark.testing.schemas import schema_folder

HORSE = Subject("horse-gallop", "horse-gallop.usdc", None, (("horse-gallop.usdc", "0" * 64),))
NOISE = Cell("noise", {"amplitude": 0.0005}, "frame", "noise 0.05 %", "noise")
MORE = Cell("noise", {"amplitude": 0.001}, "frame", "noise 0.10 %", "noise")
STATIC = Cell("noise", {"amplitude": 0.0005}, "frame", "noise 0.05 %", "noise", "first")
TIMES = {"read_s": 0.1, "attack_s": 0.2, "segment_s": 0.3, "distances_s": 0.4, "other_s": 0.5}
DISTORTION = {
    "rows": [
        {
            "prim": "/Horse",
            "hausdorff": 0.02,
            "mrms": 0.0005,
            "hausdorff_rel": 0.008,
            "mrms_rel": 0.0002,
            "flipped_faces": 0.0,
            "max_move_edges": 1.0,
            "flicker": 0.5,
            "flicker_world": 0.625,
            "smallest_angle": 0.25,
        }
    ],
    "timings": {"read_s": 0.1, "metrics_s": 2.0},
}


def result(average: float, maximum: float, log10_p: float = -12.0) -> dict[str, Any]:
    return {
        "ber_avg": average,
        "ber_max": maximum,
        "log10_p": log10_p,
        "log10_p_single_frame_median": log10_p / 2,
        "verified": log10_p <= -6,
        "frames_lucky": 0.25,
        "worst": {"prim": "/Horse", "time": 13.0, "part": 2, "ber": maximum},
        "notes": [],
        "timings": TIMES,
    }


UNMARKED = result(0.3, 0.4, 0.0)


@pytest.fixture
def document(tmp_path):
    """Make the report of some cells' results on the horse."""

    def make(*cells: tuple[Cell, dict[str, Any], dict[str, Any]]) -> dict[str, Any]:
        bench = Bench(Store(tmp_path / "cells"), benchmark_key(0), 0, {})
        outcome = Outcome(
            Pairing(HORSE, (Recipe("tsai2014"),)),
            {"timings": {"embed_s": 9.0}},
            DISTORTION,
            tuple((marked, control) for _, marked, control in cells),
        )
        made = document_of(
            suite=Suite("tsai2014", tuple(cell for cell, _, _ in cells)),
            recipes=[Recipe("tsai2014")],
            subjects=[(HORSE, (48, 24))],
            bench=bench,
            outcomes=[outcome],
            elapsed_s=60.0,
        )
        schema = json.loads((schema_folder("json") / "benchmark.schema.json").read_text())
        jsonschema.Draft202012Validator.check_schema(schema)
        jsonschema.validate(made, schema)
        return made

    return make


def test_worse_figures_are_marked_and_traced(document) -> None:
    page = page_of(document((NOISE, result(0.05, 0.125), UNMARKED)))
    assert "| **0.0500 worse** | 0.0443 | 0.1250 | 0.1250 |" in page
    assert "1 of the 1 rows" in page
    assert "worst is frame 13, where part 2 does best with 0.1250" in page


def test_figures_as_good_as_the_papers_are_not_marked(document) -> None:
    page = page_of(document((NOISE, result(0.0443, 0.125), UNMARKED)))
    assert "worse**" not in page.split("### horse-gallop, `tsai2014`")[1]
    assert "None of the 1 rows" in page


def test_distortion_is_compared_over_the_diagonal(document) -> None:
    page = page_of(document((NOISE, result(0.0, 0.0), UNMARKED)))
    assert "| **0.008000 (0.020000) worse** | 0.007246 | 0.000200 (0.000500) | 0.000451 |" in page
    assert "smallest angle" in page


def test_the_static_protocol_is_not_held_against_the_paper(document) -> None:
    made = document((STATIC, result(0.5, 0.5), UNMARKED), (NOISE, result(0.5, 0.5), UNMARKED))
    assert [row["paper"] is None for row in made["rows"]] == [True, False]


def test_the_page_gives_the_command_that_makes_it(document) -> None:
    plain = document((NOISE, result(0.0, 0.0), UNMARKED))
    start = "meshmark bench horse-gallop.usdc --suite tsai2014 --scheme tsai2014 "
    assert command_of(plain) == start + f"--row '{NOISE.label}' --seed 0 -o FOLDER"
    whole = [(cell, result(0.0, 0.0), UNMARKED) for cell in SUITES["tsai2014"].cells]
    assert command_of(document(*whole)) == start + "--seed 0 -o FOLDER"
    extra = cell_from_text("cropping:share=0.4,direction=0;1;0")
    recipe = Recipe("tsai2014", settings={"tsai2014": {"bits": 24}, "sdf": {"rays": 36}})
    told = {
        **document((NOISE, result(0.0, 0.0), UNMARKED), (extra, result(0.0, 0.0), UNMARKED)),
        "schemes": [recipe.as_json()],
        "frames": "1:9:2",
    }
    assert command_of(told) == (
        start + "--set tsai2014.bits=24 --set sdf.rays=36 "
        f"--row '{NOISE.label}' --attack 'cropping:share=0.4,direction=0;1;0' "
        "--frames 1:9:2 --seed 0 -o FOLDER"
    )
    assert f"$ {command_of(told)}" in page_of(told)


def test_repeated_frames_are_told(document) -> None:
    page = page_of(document((NOISE, result(0.0, 0.0), UNMARKED)))
    assert "48 frames, of which only 24 differ" in page


def test_an_unmarked_copy_that_is_found_cannot_be_missed(document) -> None:
    good = page_of(document((NOISE, result(0.0, 0.0), UNMARKED)))
    assert "Control: 0 of 1 unmarked copies found; by luck alone, 25.0%" in good
    bad = page_of(document((NOISE, result(0.0, 0.0), result(0.0, 0.0))))
    assert "**Control: 1 of 1 unmarked copies found" in bad


def test_failed_cells_give_their_reason_and_the_exit_code_tells(document) -> None:
    fine = document((NOISE, result(0.0, 0.0), UNMARKED))
    assert exit_code(fine) == 0
    lost = document((NOISE, result(0.4, 0.5, 0.0), UNMARKED))
    assert exit_code(lost) == 0
    failed = {"error": "nothing is left", "plugin": False}
    made = document((NOISE, failed, failed), (MORE, result(0.0, 0.0), UNMARKED))
    assert exit_code(made) == 1
    assert failures(made) == ["horse-gallop: tsai2014: noise 0.05 % (per frame): nothing is left"]
    assert made["rows"][0]["ber_avg"] is None
    assert made["rows"][0]["verified"] is False
    page = page_of(made)
    assert "## Could not run" in page
    assert "could not run" in page
    assert exit_code(document((NOISE, {"error": "broken", "plugin": True}, UNMARKED))) == 5


def test_costs_are_added_up(document) -> None:
    page = page_of(document((NOISE, result(0, 0), UNMARKED), (MORE, result(0, 0), UNMARKED)))
    assert "| horse-gallop | `tsai2014` | 9.0 | 2.0 | 0.4 | 0.8 | 1.2 | 1.6 | 2.0 |" in page


def test_plots_come_one_a_family(document, tmp_path) -> None:
    assert can_plot()
    alone = Cell("similarity", {}, "animation", "similarity transformation", "similarity")
    made = document(
        (NOISE, result(0.0, 0.0), UNMARKED),
        (MORE, result(0.1, 0.2), UNMARKED),
        (alone, result(0.0, 0.0), UNMARKED),
    )
    [name] = draw_plots(made, tmp_path)
    assert name == "noise.png"
    first = (tmp_path / name).read_bytes()
    assert first.startswith(b"\x89PNG")
    draw_plots(made, tmp_path)
    assert (tmp_path / name).read_bytes() == first
    assert "![noise](noise.png)" in page_of(made, [name])


def test_attacks_are_seeded_by_what_they_do_not_by_where_they_stand(tmp_path) -> None:
    def seed(of: int, subject: Subject, cell: Cell) -> int:
        return cell_seed(Bench(Store(tmp_path), benchmark_key(of), of, {}), subject, cell)

    again = Cell("noise", {"amplitude": 0.0005}, "frame", "another name", "another family")
    assert seed(0, HORSE, NOISE) == seed(0, HORSE, again)
    other = Subject("horse-gallop", "x", None, (("x", "1" * 64),))
    seeds = {
        seed(0, HORSE, NOISE),
        seed(1, HORSE, NOISE),
        seed(0, HORSE, MORE),
        seed(0, HORSE, STATIC),
        seed(0, other, NOISE),
    }
    assert len(seeds) == 5


def test_keys_are_public_and_differ_by_seed() -> None:
    assert benchmark_key(0).id == benchmark_key(0).id
    assert benchmark_key(0).id != benchmark_key(1).id


def test_a_verdict_becomes_the_figures_of_a_row() -> None:
    key = benchmark_key(0)
    words = key.words("tsai2014", 2, 16)
    value = np.tile(0.05 * words, (4, 1, 1))
    # Frame 2: three bits of one part wrong, four of the other.
    value[2, 0, :3] *= -1
    value[2, 1, :4] *= -1
    variant = RestoredVariant.of(value[:, None] / 0.05, np.zeros(1))
    evidence = Evidence("/A", "tsai2014", 2, np.arange(4.0), (variant,))
    row = describe(decide("a", [evidence], key))
    assert row["ber_avg"] == pytest.approx(3 / 16 / 4)
    assert row["ber_max"] == 3 / 16
    assert row["worst"] == {"prim": "/A", "time": 2.0, "part": 0, "ber": 3 / 16}
    assert row["frames_lucky"] == 1.0
    assert row["verified"] is True
    assert row["log10_p_single_frame_median"] < -6


def test_a_verdict_on_nothing_is_no_find() -> None:
    row = describe(decide("a", [], benchmark_key(0), notes=["/A: tsai2014: no carrier"]))
    assert row["ber_avg"] is None
    assert row["verified"] is False
    assert row["log10_p"] == 0.0
    assert row["notes"] == ["/A: tsai2014: no carrier"]


def test_what_an_attack_did_is_measured_over_frames_where_none_went() -> None:
    V, F = sphere(4000)
    points = np.array([V, 2.0 * V])
    before = MeshAnimation.from_arrays(points, F)
    # Grown by a hundredth of the radius; the box's diagonal is 2 sqrt 3 radii, about.
    grown = MeshAnimation.from_arrays(1.01 * points, F)
    diagonal = np.linalg.norm(np.ptp(V, axis=0))
    found = attack_mrms(as_asset(before), as_asset(grown))
    assert found == pytest.approx(0.01 / diagonal, rel=0.02)
    assert attack_mrms(as_asset(before), as_asset(before)) == pytest.approx(0.0, abs=1e-7)
    assert attack_mrms(as_asset(before), as_asset(grown.select([0]))) is None


def test_frames_without_extent_are_left_out_of_what_an_attack_did() -> None:
    V, F = sphere(200)
    nothing = MeshAnimation.from_arrays(np.array([0.0 * V, V]), F)
    assert attack_mrms(as_asset(nothing), as_asset(nothing)) == pytest.approx(0.0, abs=1e-7)
    gone = nothing.select([0])
    assert attack_mrms(as_asset(gone), as_asset(gone)) is None


def test_what_an_attack_did_is_in_the_report(document) -> None:
    made = document((NOISE, {**result(0.0, 0.0), "attack_mrms_rel": 0.00025}, UNMARKED))
    assert made["rows"][0]["attack_mrms_rel"] == 0.00025
    assert "| 0.000250 |" in page_of(made)
