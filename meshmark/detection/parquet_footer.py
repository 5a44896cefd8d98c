"""What a Parquet file says of itself, read without the library, which a hostile one can abort.

pyarrow 26 ends the process where the words about a column contradict the schema, before it can be
asked how large the column is. So the footer is read here first: Thrift's compact protocol, and of
it what a file of a store may say.
"""

from __future__ import annotations

from typing import IO, Any

MAGIC = b"PAR1"
# At the end: the length of the footer, and the magic.
ENDING = 8
# Words deeper than any of Parquet's.
DEEPEST = 16
# Of Thrift's compact protocol: types of fields.
TRUE, FALSE, BYTE, I16, I32, I64, DOUBLE, BINARY, LIST, SET, MAP, STRUCT, UUID = range(1, 14)

# Fields of FileMetaData, SchemaElement, RowGroup, ColumnChunk and ColumnMetaData.
SCHEMA, ROWS, ROW_GROUPS = 2, 3, 4
REPETITION, CHILDREN = 3, 5
COLUMNS = 1
FILE_PATH, META, CRYPTO, ENCRYPTED = 1, 3, 8, 9
TYPE, ENCODINGS, CODEC, BYTES, DICTIONARY, SIZES = 1, 2, 4, 6, 11, 16
TEXT_BYTES, REPETITIONS, DEFINITIONS = 1, 2, 3
# Repetitions: required, optional. Encodings: plain, run lengths. Type: byte array.
REQUIRED, OPTIONAL, PLAIN, RLE, BYTE_ARRAY = 0, 1, 0, 3, 6


def require_plain(file: IO[bytes], largest: int) -> None:
    """Refuse a file that is packed, nested or encrypted, or claims more than its bytes can say.

    Parameters
    ----------
    file : binary file
    largest : int
        Bytes that its footer may have.

    Raises
    ------
    ValueError
        If it is no such file.
    """
    size = file.seek(0, 2)
    if size < ENDING:
        raise ValueError("too short")
    file.seek(size - ENDING)
    ending = file.read(ENDING)
    length = int.from_bytes(ending[:4], "little")
    if ending[4:] != MAGIC or length > min(largest, size - ENDING):
        raise ValueError("no footer")
    file.seek(size - ENDING - length)
    try:
        _require_bounded(_Compact(file.read(length)).struct(), size)
    except (KeyError, TypeError, AttributeError):
        raise ValueError("footer") from None


def _require_bounded(footer: dict[int, Any], size: int) -> None:
    root, *columns = footer[SCHEMA]
    kinds = {each[REPETITION] for each in columns if CHILDREN not in each}
    flat = kinds <= {REQUIRED, OPTIONAL} and not any(CHILDREN in each for each in columns)
    if not flat or root[CHILDREN] != len(columns):
        raise ValueError("nested")
    groups = footer[ROW_GROUPS]
    if not all(0 <= each[ROWS] <= size for each in (footer, *groups)):
        raise ValueError("rows")
    for group in groups:
        for element, chunk in zip(columns, group[COLUMNS], strict=True):
            if chunk.keys() & {FILE_PATH, CRYPTO, ENCRYPTED}:
                raise ValueError("elsewhere")
            _require_plain_column(chunk[META], element, size)


def _require_plain_column(told: dict[int, Any], element: dict[int, Any], size: int) -> None:
    plain = told[CODEC] == 0 and set(told[ENCODINGS]) <= {PLAIN, RLE} and DICTIONARY not in told
    if not plain or not 0 <= told[BYTES] <= size or told[TYPE] != element[TYPE]:
        raise ValueError("packed")
    sizes = told.get(SIZES, {})
    counts = len(sizes.get(REPETITIONS, ())), len(sizes.get(DEFINITIONS, ()))
    if counts[0] not in (0, 1) or counts[1] not in (0, 1 + element[REPETITION]):
        raise ValueError("levels")
    if TEXT_BYTES in sizes and told[TYPE] != BYTE_ARRAY:
        raise ValueError("bytes")


class _Compact:
    """Reads Thrift's compact protocol: structs as dicts by the numbers of their fields."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at, self._depth = data, 0, 0

    def struct(self) -> dict[int, Any]:
        fields: dict[int, Any] = {}
        number = 0
        self._depth += 1
        if self._depth > DEEPEST:
            raise ValueError("too deep")
        while head := self._take(1)[0]:
            kind = head & 15
            number = number + (head >> 4) if head >> 4 else self._signed()
            fields[number] = kind == TRUE if kind in (TRUE, FALSE) else self._value(kind)
        self._depth -= 1
        return fields

    def _value(self, kind: int) -> Any:
        if kind in (TRUE, FALSE, BYTE):
            return self._take(1)[0]
        if kind in (I16, I32, I64):
            return self._signed()
        if kind in (DOUBLE, UUID):
            return self._take(8 if kind == DOUBLE else 16)
        if kind == BINARY:
            return self._take(self._unsigned())
        if kind in (LIST, SET):
            return self._list()
        if kind == STRUCT:
            return self.struct()
        # No words of Parquet have maps.
        raise ValueError("type")

    def _list(self) -> list[Any]:
        head = self._take(1)[0]
        n = self._unsigned() if head >> 4 == 15 else head >> 4
        # Each takes a byte at least.
        if n > len(self._data) - self._at:
            raise ValueError("too long")
        return [self._value(head & 15) for _ in range(n)]

    def _signed(self) -> int:
        number = self._unsigned()
        return (number >> 1) ^ -(number & 1)

    def _unsigned(self) -> int:
        number = shift = 0
        while shift < 70:
            byte = self._take(1)[0]
            number |= (byte & 127) << shift
            if byte < 128:
                return number
            shift += 7
        raise ValueError("number")

    def _take(self, n: int) -> bytes:
        taken = self._data[self._at : self._at + n]
        if len(taken) < n:
            raise ValueError("too short")
        self._at += n
        return taken
