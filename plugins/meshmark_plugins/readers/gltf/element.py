"""Typed access to JSON: what is not as it should be is an error that names its place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

from meshmark.errors import InputError
from meshmark.mesh.checks import FARTHEST

# Beyond, no count or offset of a file makes sense; numpy's integers hold it, and its multiples.
LARGEST = 1 << 40
# A Python number: integers of any size can be compared with it.
FARTHEST_NUMBER = float(FARTHEST)
MOST_SHOWN = 40


@dataclass(frozen=True, slots=True)
class Element:
    """An object of a JSON document.

    Parameters
    ----------
    members : mapping
        Its members, of any type.
    place : str
        Where it is, such as `nodes[3]`; empty for the document itself.

    Raises
    ------
    InputError
        From every method, if a member is missing, of another type or out of range.
    """

    members: Mapping[str, Any]
    place: str = ""

    def __contains__(self, name: str) -> bool:
        return name in self.members

    def fail(self, name: str, message: str) -> NoReturn:
        """Raise an error about a member."""
        raise InputError(f"{self._place(name)} {message}")

    def integer(
        self, name: str, *, low: int = 0, high: int = LARGEST, default: int | None = None
    ) -> int:
        """Return an integer within a range, both ends included."""
        value = self._member(name, default)
        if type(value) is not int:
            self.fail(name, f"is {_shown(value)}, not an integer")
        if not low <= value <= high:
            self.fail(name, f"is {_shown(value)}, not within {low} .. {high}")
        return value

    def index(self, name: str, things: Sequence[object]) -> int:
        """Return the index of one of some things."""
        return _index(self._member(name, None), len(things), self._place(name))

    def optional_index(self, name: str, things: Sequence[object]) -> int | None:
        """Return the index of one of some things, None if there is no such member."""
        return self.index(name, things) if name in self.members else None

    def indices(self, name: str, things: Sequence[object]) -> tuple[int, ...]:
        """Return indices of some things; none if there is no such member."""
        place = self._place(name)
        return tuple(
            _index(value, len(things), f"{place}[{i}]") for i, value in enumerate(self._list(name))
        )

    def numbers(self, name: str, n: int, default: Sequence[float]) -> tuple[float, ...]:
        """Return a list of `n` finite numbers."""
        values = self._list(name) if name in self.members else default
        if len(values) != n:
            self.fail(name, f"has {len(values)} numbers, not {n}")
        for value in values:
            if type(value) not in (int, float) or not -FARTHEST_NUMBER <= value <= FARTHEST_NUMBER:
                self.fail(name, f"holds {_shown(value)}, which is not a number, or far too large")
        return tuple(map(float, values))

    def text(self, name: str, default: str | None = None) -> str:
        """Return a text."""
        value = self._member(name, default)
        if type(value) is not str:
            self.fail(name, f"is {_shown(value)}, not a text")
        return value

    def one_of(self, name: str, choices: Sequence[str], default: str | None = None) -> str:
        """Return a text that is one of some."""
        value = self.text(name, default)
        if value not in choices:
            self.fail(name, f"is {_shown(value)}, not one of {', '.join(choices)}")
        return value

    def flag(self, name: str) -> bool:
        """Return true or false; false if there is no such member."""
        value = self._member(name, False)
        if type(value) is not bool:
            self.fail(name, f"is {_shown(value)}, not true or false")
        return value

    def object(self, name: str) -> Element:
        """Return an object; an empty one if there is no such member."""
        return _element(self._member(name, {}), self._place(name))

    def objects(self, name: str) -> tuple[Element, ...]:
        """Return a list of objects; none if there is no such member."""
        place = self._place(name)
        return tuple(_element(value, f"{place}[{i}]") for i, value in enumerate(self._list(name)))

    def extension(self, *names: str) -> Element | None:
        """Return the first of some extensions that the object has; None if it has none."""
        extensions = self.object("extensions")
        return next((extensions.object(name) for name in names if name in extensions), None)

    def _member(self, name: str, default: Any) -> Any:
        value = self.members.get(name, default)
        if value is None:
            self.fail(name, "is missing" if name not in self.members else "is null")
        return value

    def _list(self, name: str) -> list[Any]:
        value = self._member(name, [])
        if type(value) is not list:
            self.fail(name, f"is {_shown(value)}, not a list")
        return value

    def _place(self, name: str) -> str:
        return f"{self.place}.{name}" if self.place else name


def _element(value: object, place: str) -> Element:
    if not isinstance(value, dict):
        raise InputError(f"{place} is {_shown(value)}, not an object")
    return Element(value, place)


def _index(value: object, n: int, place: str) -> int:
    if type(value) is not int:
        raise InputError(f"{place} is {_shown(value)}, not an integer")
    if not 0 <= value < n:
        raise InputError(f"{place} is {_shown(value)}, but there are {n}")
    return value


def _shown(value: object) -> str:
    """Spell a value briefly, in one line."""
    if isinstance(value, (list, dict)):
        return "a list" if isinstance(value, list) else "an object"
    if isinstance(value, int) and abs(value) > LARGEST:
        return "a huge number"
    text = ascii(value)
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}..."
