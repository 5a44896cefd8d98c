"""Typed access to JSON: what is not as it should be is an error that names its place."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain
from typing import Any, NoReturn, overload

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.errors import InputError
from meshmark.mesh.checks import FARTHEST

# Beyond, no count or offset of a file makes sense; numpy's integers hold it, and its multiples.
LARGEST = 1 << 40
# A Python number: integers of any size can be compared with it.
FARTHEST_NUMBER = float(FARTHEST)
MOST_SHOWN = 40
ABSENT = object()


class Element:
    """An object of a JSON document.

    Parameters
    ----------
    members : mapping
        Its members, of any type.
    parent : Element, optional
        The object that it is a member of; none for the document itself.
    step : str
        Which member of that it is.
    number : int, optional
        Which element of that member, if it is a list.

    Raises
    ------
    InputError
        From every method, if a member is missing, of another type or out of range.
    """

    __slots__ = ("_number", "_parent", "_step", "members")

    def __init__(
        self,
        members: Mapping[str, Any],
        parent: Element | None = None,
        step: str = "",
        number: int | None = None,
    ) -> None:
        self.members = members
        self._parent, self._step, self._number = parent, step, number

    @property
    def place(self) -> str:
        """Where it is, such as `nodes[3]`; empty for the document itself."""
        # Spelled only when something is wrong: documents have thousands of objects.
        before = "" if self._parent is None else self._parent.place
        name = f"{before}.{self._step}" if before else self._step
        return name if self._number is None else f"{name}[{self._number}]"

    def __contains__(self, name: str) -> bool:
        return name in self.members

    def fail(self, name: str, message: str) -> NoReturn:
        """Raise an error about a member."""
        raise InputError(f"{self._place(name)} {message}")

    def integer(
        self, name: str, *, low: int = 0, high: int = LARGEST, default: int | None = None
    ) -> int:
        """Return an integer within a range, both ends included."""
        value = self.members.get(name, default)
        if type(value) is not int:
            self._fail_type(name, value, "an integer")
        if not low <= value <= high:
            self.fail(name, f"is {_shown(value)}, not within {low} .. {high}")
        return value

    def index(self, name: str, things: Sequence[object]) -> int:
        """Return the index of one of some things."""
        value = self.members.get(name)
        if type(value) is not int:
            self._fail_type(name, value, "an integer")
        if not 0 <= value < len(things):
            self.fail(name, f"is {_shown(value)}, but there are {len(things)}")
        return value

    def optional_index(self, name: str, things: Sequence[object]) -> int | None:
        """Return the index of one of some things, None if there is no such member."""
        return self.index(name, things) if name in self.members else None

    def indices(self, name: str, things: Sequence[object]) -> tuple[int, ...]:
        """Return indices of some things; none if there is no such member."""
        if name not in self.members:
            return ()
        found, n = self._list(name), len(things)
        for i, value in enumerate(found):
            if type(value) is not int or not 0 <= value < n:
                fault = f"but there are {n}" if type(value) is int else "not an integer"
                self.fail(f"{name}[{i}]", f"is {_shown(value)}, {fault}")
        return tuple(found)

    def numbers(self, name: str, n: int, default: tuple[float, ...]) -> tuple[float, ...]:
        """Return a list of `n` finite numbers."""
        if name not in self.members:
            return default
        values = self._list(name)
        if len(values) != n:
            self.fail(name, f"has {len(values)} numbers, not {n}")
        if not _are_numbers(values):
            wrong = next(value for value in values if not _are_numbers([value]))
            self.fail(name, f"holds {_shown(wrong)}, which is not a number, or far too large")
        return tuple(map(float, values))

    def text(self, name: str, default: str | None = None) -> str:
        """Return a text."""
        value = self.members.get(name, default)
        if type(value) is not str:
            self._fail_type(name, value, "a text")
        return value

    def one_of(self, name: str, choices: Sequence[str], default: str | None = None) -> str:
        """Return a text that is one of some."""
        value = self.text(name, default)
        if value not in choices:
            self.fail(name, f"is {_shown(value)}, not one of {', '.join(choices)}")
        return value

    def flag(self, name: str) -> bool:
        """Return true or false; false if there is no such member."""
        value = self.members.get(name, False)
        if type(value) is not bool:
            self._fail_type(name, value, "true or false")
        return value

    def object(self, name: str) -> Element:
        """Return an object; an empty one if there is no such member."""
        value = self.members.get(name, {})
        if type(value) is not dict:
            self._fail_type(name, value, "an object")
        return Element(value, self, name)

    def objects(self, name: str) -> Elements:
        """Return a list of objects; an empty one if it is missing."""
        values = self._list(name) if name in self.members else []
        return Elements(values, lambda i: Element(values[i], self, name, i))

    def extension(self, *names: str) -> Element | None:
        """Return the first of some extensions that the object has; None if it has none."""
        if "extensions" not in self.members:
            return None
        extensions = self.object("extensions")
        return next((extensions.object(name) for name in names if name in extensions), None)

    def _list(self, name: str) -> list[Any]:
        value = self.members.get(name)
        if type(value) is not list:
            self._fail_type(name, value, "a list")
        return value

    def _fail_type(self, name: str, value: Any, wanted: str) -> NoReturn:
        if value is None:
            self.fail(name, "is null" if name in self.members else "is missing")
        self.fail(name, f"is {_shown(value)}, not {wanted}")

    def _place(self, name: str) -> str:
        return f"{self.place}.{name}" if self.place else name


class Elements(Sequence[Element]):
    """Objects of a JSON document, each looked at when it is asked for; or a member of all of them.

    Members of all are looked at together. Only if one is wrong, they are one by one, to say which.

    Parameters
    ----------
    values : list
    element : callable
        Makes the element of a number, not looking at it.
    """

    def __init__(self, values: list[Any], element: Callable[[int], Element]) -> None:
        self._values, self._make = values, element

    def __len__(self) -> int:
        return len(self._values)

    @overload
    def __getitem__(self, index: int) -> Element: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[Element]: ...

    def __getitem__(self, index: int | slice) -> Element | Sequence[Element]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        found = self._make(index)
        if type(found.members) is not dict:
            raise InputError(f"{found.place} is {_shown(found.members)}, not an object")
        return found

    def __iter__(self) -> Iterator[Element]:
        return map(self.__getitem__, range(len(self)))

    def chosen(self, numbers: Sequence[int]) -> Elements:
        """Return some of the objects, by their numbers."""
        return Elements([self._values[i] for i in numbers], lambda i: self[numbers[i]])

    def having(self, name: str) -> list[int]:
        """List the numbers of the objects that have a member."""
        found = self._members(name, ABSENT)
        return [i for i, value in enumerate(found) if value is not ABSENT]

    def indices(self, name: str, things: Sequence[object]) -> list[int]:
        """Return the index of one of some things, of each."""
        found = self._members(name, None)
        if set(map(type, found)) <= {int} and _within(found, len(things)):
            return found
        return [each.index(name, things) for each in self]

    def texts(self, name: str, default: str | None = None) -> list[str]:
        """Return a text of each."""
        found = self._members(name, default)
        if set(map(type, found)) <= {str}:
            return found
        return [each.text(name, default) for each in self]

    def choices(self, name: str, choices: Sequence[str], default: str) -> list[str]:
        """Return a text of each that is one of some."""
        found = self.texts(name, default)
        if set(found) <= set(choices):
            return found
        return [each.one_of(name, choices, default) for each in self]

    def index_lists(self, name: str, things: Sequence[object]) -> Sequence[Sequence[int]]:
        """Return indices of some things, of each; none where there is no such member."""
        found = self._members(name, ())
        flat = _flat(found)
        if flat is not None and set(map(type, flat)) <= {int} and _within(flat, len(things)):
            return found
        return [each.indices(name, things) for each in self]

    def numbers(self, defaults: Mapping[str, tuple[float, ...]]) -> FloatArray:
        """Return lists of finite numbers of each behind each other, (len, n) float64.

        Parameters
        ----------
        defaults : mapping of str to tuple of float
            The lists, and what they are where there are none.
        """
        columns = [self._members(name, default) for name, default in defaults.items()]
        lists = list(chain.from_iterable(zip(*columns, strict=True)))
        lengths = [len(default) for default in defaults.values()]
        flat = _flat(lists)
        if flat is None or [*map(len, lists)] != lengths * len(self) or not _are_numbers(flat):
            flat = [
                number
                for each in self
                for name, default in defaults.items()
                for number in each.numbers(name, len(default), default)
            ]
        return np.array(flat, dtype=np.float64).reshape(len(self), sum(lengths))

    def objects(self, name: str) -> Elements:
        """Return an object of each; an empty one if there is no such member."""
        return Elements(self._members(name, {}), lambda i: self[i].object(name))

    def _members(self, name: str, default: Any) -> list[Any]:
        try:
            return [value.get(name, default) for value in self._values]
        except AttributeError:
            # One is no object: say which.
            list(self)
            raise


def _within(numbers: Sequence[int], n: int) -> bool:
    return not numbers or (min(numbers) >= 0 and max(numbers) < n)


def _are_numbers(values: Sequence[Any]) -> bool:
    if not set(map(type, values)) <= {int, float}:
        return False
    return max(map(abs, values), default=0) <= FARTHEST_NUMBER


def _flat(values: list[Any]) -> list[Any] | None:
    """Put lists behind each other; None if one is none."""
    are_lists = set(map(type, values)) <= {list, tuple}
    return list(chain.from_iterable(values)) if are_lists else None


def _shown(value: object) -> str:
    """Spell a value briefly, in one line."""
    if isinstance(value, (list, dict)):
        return "a list" if isinstance(value, list) else "an object"
    if isinstance(value, int) and abs(value) > LARGEST:
        return "a huge number"
    text = ascii(value)
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}..."
