from __future__ import annotations

import pickle

import numpy as np
import pytest

from meshmark.detection.evidence import Made
from meshmark.errors import OutputError
from meshmark.workers.spool import Spool


@pytest.mark.parametrize("room", [1, 1 << 20], ids=["on disk", "in memory"])
def test_things_come_back_by_their_numbers(room) -> None:
    spool: Spool[np.ndarray | None] = Spool(room)
    things = [np.arange(n) for n in range(40)]
    assert [spool.add(thing) for thing in things] == list(range(40))
    assert spool.add(None) == 40
    assert len(spool) == 41
    for number in (39, 0, 17):
        np.testing.assert_array_equal(spool[number], things[number])
    assert spool[40] is None
    # Reading does not put later ones out of place.
    assert spool.add(things[3]) == 41
    np.testing.assert_array_equal(spool[41], things[3])


def test_a_full_disk_is_told_of(monkeypatch) -> None:
    spool: Spool[bytes] = Spool(1)

    def refuse(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(spool._file, "write", refuse)
    with pytest.raises(OutputError, match="No space left"):
        spool.add(b"x")
    monkeypatch.undo()
    assert spool.add(b"y") == 0
    assert spool[0] == b"y"


def test_items_are_made_when_they_are_asked_for() -> None:
    made: list[int] = []
    squares = Made(lambda i: made.append(i) or i * i, 5)
    assert (len(squares), made) == (5, [])
    assert (squares[2], squares[-1]) == (4, 16)
    assert made == [2, 4]
    assert list(squares) == [0, 1, 4, 9, 16]
    assert list(squares[1:4][::-1]) == [9, 4, 1]
    with pytest.raises(IndexError):
        squares[5]
    assert pickle.loads(pickle.dumps(squares)) == (0, 1, 4, 9, 16)
