"""The suites hold what they claim, and the paper's figures stand in the right rows."""

from __future__ import annotations

import pytest

from meshmark.benchmarking.published_figures import ERROR_DIGIT, TABLE_1, TABLE_2, worse
from meshmark.benchmarking.suite_rows import NO_ATTACK, cell_from_text
from meshmark.benchmarking.suites import SUITES, suite_named
from meshmark.errors import UsageError
from meshmark.extension.registry import catalogue, make_attack

PAPER_ROWS = {row for _, row in TABLE_2}


@pytest.mark.parametrize("suite", SUITES.values(), ids=SUITES)
def test_every_attack_can_be_made(suite) -> None:
    for cell in suite.cells:
        if cell.attack != NO_ATTACK:
            make_attack(cell.attack, **cell.parameters)


@pytest.mark.parametrize("suite", SUITES.values(), ids=SUITES)
def test_no_cell_comes_twice(suite) -> None:
    names = [(cell.label, cell.per, cell.frames) for cell in suite.cells]
    assert len(set(names)) == len(names)
    work = [
        (cell.attack, str(sorted(cell.parameters.items())), cell.frames, cell.others)
        for cell in suite.cells
    ]
    assert len(set(work)) == len(work)


@pytest.mark.parametrize("suite", SUITES.values(), ids=SUITES)
def test_per_is_what_the_attack_is_told(suite) -> None:
    for cell in suite.cells:
        assert cell.parameters.get("per", cell.per) == cell.per


def test_tsai2014_has_every_row_of_the_paper_and_the_copy_left_alone() -> None:
    labels = {cell.label for cell in SUITES["tsai2014"].cells}
    assert len(PAPER_ROWS) == 13
    assert labels == PAPER_ROWS | {"no attack"}


def test_what_changes_connectivity_is_reported_both_ways() -> None:
    for suite in (SUITES["tsai2014"], SUITES["animation"]):
        both = {
            cell.label
            for cell in suite.cells
            if cell.attack in ("simplification", "cropping", "remeshing-sdf", "reorder")
        }
        for label in both:
            ways = {cell.per for cell in suite.cells if cell.label == label}
            assert ways == {"frame", "animation"}


def test_liris_has_all_levels_on_the_first_frame_and_on_all() -> None:
    levels = {
        "amplitude": (0.0005, 0.001, 0.003, 0.005),
        "iterations": (5, 10, 30, 50),
        "bits": (11, 10, 9, 8, 7),
        "ratio": (0.1, 0.3, 0.5, 0.7, 0.9, 0.95, 0.975),
        "scheme": ("midpoint", "sqrt3", "loop"),
        "share": (0.1, 0.3, 0.5),
    }
    for frames in ("first", "all"):
        cells = [cell for cell in SUITES["liris"].cells if cell.frames == frames]
        for parameter, values in levels.items():
            found = [c.parameters[parameter] for c in cells if parameter in c.parameters]
            assert tuple(dict.fromkeys(found)) == values
        assert {"similarity", "reorder"} <= {cell.attack for cell in cells}


def test_suites_try_every_attack_there_is() -> None:
    names = ("animation", "hiding", "informed")
    tried = {cell.attack for name in names for cell in SUITES[name].cells}
    builtin = {
        offer.name
        for offer in catalogue().of_kind("attack")
        if offer.record.factory.__module__.startswith("meshmark_plugins")
    }
    assert tried - {NO_ATTACK} == builtin


def test_informed_holds_the_leaks_and_crowds_of_colluders() -> None:
    cells = SUITES["informed"].cells
    assert set(map(repr, SUITES["leaks"].cells)) < set(map(repr, cells))
    crowds = {(cell.parameters["kind"], cell.others) for cell in cells if cell.others}
    kinds = ("mean", "median", "min", "max", "choice", "extremes")
    every = {(kind, n - 1) for kind in kinds for n in (2, 3, 5, 10, 20)}
    assert crowds == every - {("median", 1)}
    assert all(cell.attack == "collusion" for cell in cells if cell.others)


def test_the_papers_figures_are_complete() -> None:
    assert len(TABLE_2) == 13 * len(TABLE_1)
    for (asset, _), errors in TABLE_2.items():
        assert asset in TABLE_1
        # Sixteen bits: errors of a frame come in sixteenths.
        assert errors.average <= errors.maximum
        assert errors.maximum * 16 == int(errors.maximum * 16)


def test_worse_is_above_the_printed_figure_or_missing() -> None:
    assert not worse(0.03906, 0.0391, ERROR_DIGIT)
    assert not worse(0.03914, 0.0391, ERROR_DIGIT)
    assert worse(0.03916, 0.0391, ERROR_DIGIT)
    assert worse(None, 0.0391, ERROR_DIGIT)


def test_an_unknown_suite_is_told_the_known_ones() -> None:
    with pytest.raises(UsageError, match="tsai2014, liris, animation, leaks, hiding, informed"):
        suite_named("nonsense")


def test_a_cell_is_read_from_text() -> None:
    cell = cell_from_text("cropping:share=0.5,direction=0;1;0,per=frame")
    assert cell.attack == "cropping"
    assert cell.parameters == {"share": 0.5, "direction": "0,1,0", "per": "frame"}
    assert cell.per == "frame"
    assert cell_from_text("reverse").per == "animation"
    assert cell_from_text("noise").per == "frame"
    assert cell_from_text("nonsense:x=1").parameters == {"x": "1"}


@pytest.mark.parametrize("text", ["", ":share=1", "cropping:share", "smoothing:iterations=many"])
def test_a_cell_that_cannot_be_read_is_refused(text) -> None:
    with pytest.raises(UsageError):
        cell_from_text(text)


def test_some_rows_are_kept_by_their_labels() -> None:
    suite = SUITES["tsai2014"]
    assert suite.only([]) == suite
    kept = suite.only(["no attack", "cropping *"])
    assert {cell.family for cell in kept.cells} == {"none", "cropping"}
    assert 1 < len(kept.cells) < len(suite.cells)
    with pytest.raises(UsageError, match="tsai2014 has no row 'cropping'"):
        suite.only(["no attack", "cropping"])
