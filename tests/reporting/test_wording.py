"""Odds, shares and drawings are what they say: worked by hand."""

from __future__ import annotations

import doctest
import struct
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meshmark.reporting import wording
from meshmark.reporting.chart import HEIGHT, chart
from meshmark.reporting.colours import STEPS, heat_colours, rgb
from meshmark.reporting.facts import LONGEST, MOST_ROWS, Section, Series, Table, shortened
from meshmark.reporting.png import png
from meshmark.reporting.wording import factor, odds


def test_examples_in_the_docstrings() -> None:
    found = doctest.testmod(wording)
    assert found.failed == 0
    assert found.attempted == 3


@given(st.floats(-14.5, -0.5))
def test_odds_never_promise_more_than_the_bound(log10_p: float) -> None:
    told = int(odds(log10_p).removeprefix("1 in ").replace(",", ""))
    exact = 10.0**-log10_p
    assert 0.9 * exact - 1.0 < told <= exact * (1 + 1e-8)


def test_factors_are_told_to_three_digits() -> None:
    assert factor(0.0) == "× 1"
    assert factor(np.log10(8)) == "× 8"
    assert factor(np.log10(12345)) == "× 12,345"


def test_bars_are_as_high_as_the_evidence() -> None:
    drawn = chart(Series("/a by apex", ("1", "2", "3"), (-10.0, -5.0, 0.0)), limit=-6.0)
    one, two, three = (bar.height for bar in drawn.bars)
    assert one == pytest.approx(2 * two)
    assert three == 0.0
    assert drawn.bars[0].y + one == pytest.approx(drawn.base)
    assert drawn.limit == pytest.approx(drawn.base - 0.6 * one)
    assert [label for _, label in drawn.marks] == ["0", "−2", "−4", "−6", "−8", "−10"]
    assert "from 0.00 to −10.00, the strongest at time 1" in drawn.told


def test_a_thousand_frames_are_still_a_drawing() -> None:
    times = tuple(f"{i}" for i in range(1000))
    drawn = chart(Series("/a", times, tuple(-float(i) for i in range(1000))), limit=-6.0)
    assert len(drawn.bars) == 240
    assert len(drawn.times) <= 9
    assert all(0.0 <= bar.y <= HEIGHT for bar in drawn.bars)


def test_long_tables_and_texts_are_cut_and_say_so() -> None:
    table = Table("t", ("a",), tuple((f"{i}",) for i in range(MOST_ROWS + 7)))
    assert len(table.printed) == MOST_ROWS
    assert table.more == 7
    told = Section("s", notes=("x",) * (MOST_ROWS + 3)).printed_notes
    assert told[-1] == "and 3 more"
    assert len(shortened("y" * 5000)) <= LONGEST


def test_columns_in_which_nothing_stands_are_left_out() -> None:
    table = Table("t", ("a", "b", "c"), (("1", "", "2"), ("3", "", "")), (2,)).without_empty()
    assert table.columns == ("a", "c")
    assert table.rows == (("1", "2"), ("3", ""))
    assert table.numbers == (1,)


def test_colours_run_from_dark_to_light() -> None:
    brightness = [sum(rgb(each)) for each in heat_colours()]
    assert len(brightness) == STEPS
    assert heat_colours()[0] == "#440154"
    assert heat_colours()[-1] == "#fde725"
    assert min(np.diff(brightness)) >= -3


def test_a_picture_is_read_back_as_it_was() -> None:
    picture = np.random.default_rng(1).integers(0, 256, (5, 7, 4)).astype(np.uint8)
    data = png(picture)
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert struct.unpack(">II", data[16:24]) == (7, 5)
    at = data.index(b"IDAT")
    length = struct.unpack(">I", data[at - 4 : at])[0]
    content = data[at + 4 : at + 4 + length]
    assert struct.unpack(">I", data[at + 4 + length : at + 8 + length])[0] == zlib.crc32(
        b"IDAT" + content
    )
    rows = np.frombuffer(zlib.decompress(content), dtype=np.uint8).reshape(5, 1 + 7 * 4)
    assert (rows[:, 0] == 2).all()
    assert (np.cumsum(rows[:, 1:], axis=0, dtype=np.uint8).reshape(picture.shape) == picture).all()
