from __future__ import annotations

import pickle

import numpy as np
import pytest

from meshmark.detection.evidence import LazySequence
from meshmark.errors import OutputError
from meshmark.workers.disk_list import DiskList


@pytest.mark.parametrize("room", [1, 1 << 20], ids=["on disk", "in memory"])
def test_things_come_back_by_their_numbers(monkeypatch, room) -> None:
    monkeypatch.setattr("meshmark.workers.disk_list.ROOM", room)
    disk_list: DiskList[np.ndarray | None] = DiskList()
    things = [np.arange(n) for n in range(40)]
    assert [disk_list.add(thing) for thing in things] == list(range(40))
    assert disk_list.add(None) == 40
    assert len(disk_list) == 41
    for number in (39, 0, 17):
        np.testing.assert_array_equal(disk_list[number], things[number])
    assert disk_list[40] is None
    # Reading does not put later ones out of place.
    assert disk_list.add(things[3]) == 41
    np.testing.assert_array_equal(disk_list[41], things[3])


def test_a_full_disk_is_told_of(monkeypatch) -> None:
    disk_list: DiskList[bytes] = DiskList()

    def refuse(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(disk_list._file, "write", refuse)
    with pytest.raises(OutputError, match="No space left"):
        disk_list.add(b"x")
    monkeypatch.undo()
    assert disk_list.add(b"y") == 0
    assert disk_list[0] == b"y"


def test_items_are_made_when_they_are_asked_for() -> None:
    made: list[int] = []
    squares = LazySequence(lambda i: made.append(i) or i * i, 5)
    assert (len(squares), made) == (5, [])
    assert (squares[2], squares[-1]) == (4, 16)
    assert made == [2, 4]
    assert list(squares) == [0, 1, 4, 9, 16]
    assert list(squares[1:4][::-1]) == [9, 4, 1]
    with pytest.raises(IndexError):
        squares[5]
    assert pickle.loads(pickle.dumps(squares)) == (0, 1, 4, 9, 16)
