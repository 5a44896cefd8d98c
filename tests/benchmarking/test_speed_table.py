"""The table of speed in its smallest form, and the functions it watches by their names."""

from __future__ import annotations

import re
from importlib import import_module
from operator import attrgetter
from pathlib import Path

import pytest

import meshmark
import speed_table
from meshmark.demo import creature
from speed import bench, stages
from speed.rows import ROWS
from speed.shape_diameter import MissingError


@pytest.mark.parametrize(
    ("module", "function"),
    sorted(
        {(module, function) for module, function, _ in stages.EMBED_STAGES}
        | {(module, function) for module, function, _ in stages.LOOK_STAGES}
    ),
)
def test_what_is_watched_is_a_function(module: str, function: str) -> None:
    assert callable(attrgetter(function)(import_module(module)))


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A small creature in place of the horse and the elephant."""
    monkeypatch.setenv("MESHMARK_DATA", str(tmp_path))
    asset = meshmark.Asset("creature", (creature(3000, 4),), "memory")
    for name in ("horse-gallop", "elephant-gallop"):
        meshmark.write(asset, asset, tmp_path / f"{name}.usdc")


def lines_of(printed: str) -> list[list[str]]:
    """Check that a table of speed has its form, and return the cells of its lines."""
    told, empty, *lines = printed.splitlines()
    assert re.fullmatch(r"`python benchmarks/speed_table\.py.*` at commit \S+, on \d+ cores", told)
    assert empty == ""
    cells = [line.strip("| ").split(" | ") for line in lines]
    assert tuple(cells[0]) == speed_table.COLUMNS
    assert all(len(row) == len(speed_table.COLUMNS) for row in cells)
    for _, _, *numbers in cells[2:]:
        assert all(re.fullmatch(r"-|[\d.]+( \([\d.]+\))?", number) for number in numbers)
    return cells[2:]


@pytest.mark.usefixtures("small")
def test_the_smallest_table_has_its_form(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench, "CGAL", _not_installed)
    speed_table.main(["--row", "diameters", "--largest", "5000"])
    printed = capsys.readouterr()
    rows = lines_of(printed.out)
    assert [row[:2] for row in rows] == [
        ["diameters", "elephant-gallop, ours"],
        ["diameters", "horse-gallop, ours"],
    ]
    assert all(float(cpu) > 0 and float(wall) > 0 for _, _, cpu, wall, *_ in rows)
    assert printed.err == "nothing is measured against CGAL: there is no g++\n"


def _not_installed(_: Path) -> None:
    raise MissingError("there is no g++")


@pytest.mark.slow
@pytest.mark.usefixtures("small")
def test_every_row_can_be_measured(capsys: pytest.CaptureFixture[str]) -> None:
    speed_table.main(["--frames", "2", "--names", "3", "--largest", "5000"])
    rows = lines_of(capsys.readouterr().out)
    assert {row for row, *_ in rows} == set(ROWS)
