"""Many things kept out of memory, and sequences of things made when they are asked for."""

from __future__ import annotations

import pickle
import tempfile
import weakref
from typing import Generic, TypeVar

from meshmark.errors import OutputError
from meshmark.files.temporary import no_room

Thing = TypeVar("Thing")

# Up to here all is kept in memory, and there is no file.
ROOM = 1 << 22  # bytes


class DiskList(Generic[Thing]):
    """Things that are written to a temporary file one by one, and read when asked for.

    The file has no name, and is gone with the list or its process. It has one place to read and
    write at: not for several threads at a time.
    """

    def __init__(self) -> None:
        file = tempfile.SpooledTemporaryFile(max_size=ROOM)  # noqa: SIM115
        self._file = file
        weakref.finalize(self, file.close)
        self._begins = [0]

    def __len__(self) -> int:
        return len(self._begins) - 1

    def add(self, thing: Thing) -> int:
        """Keep a thing, and return the number it is asked for by.

        Raises
        ------
        OutputError
            If there is no room for it.
        """
        data = pickle.dumps(thing, protocol=pickle.HIGHEST_PROTOCOL)
        try:
            self._file.seek(self._begins[-1])
            self._file.write(data)
            # Where a disk is full, better here than when something else is read.
            self._file.flush()
        except OSError as error:
            raise OutputError(no_room(error)) from None
        self._begins.append(self._begins[-1] + len(data))
        return len(self) - 1

    def __getitem__(self, number: int) -> Thing:
        begin, end = self._begins[number], self._begins[number + 1]
        self._file.seek(begin)
        return pickle.loads(self._file.read(end - begin))
