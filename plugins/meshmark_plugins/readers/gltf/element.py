"""Typed access to JSON: what is not as it should be is an error that names its place."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NoReturn, overload

from meshmark.errors import InputError
from meshmark.mesh.checks import FARTHEST

# Beyond, no count or offset of a file makes sense; numpy's integers hold it, and its multiples.
LARGEST = 1 << 40
# A Python number: integers of any size can be compared with it.
FARTHEST_NUMBER = float(FARTHEST)
MOST_SHOWN = 40


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
        value = self._member(name, default)
        if type(value) is not int:
            self.fail(name, f"is {_shown(value)}, not an integer")
        if not low <= value <= high:
            self.fail(name, f"is {_shown(value)}, not within {low} .. {high}")
        return value

    def index(self, name: str, things: Sequence[object]) -> int:
        """Return the index of one of some things."""
        value = self._member(name, None)
        if type(value) is int and 0 <= value < len(things):
            return value
        raise _no_index(value, len(things), self._place(name))

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
                raise _no_index(value, n, f"{self._place(name)}[{i}]")
        return tuple(found)

    def numbers(self, name: str, n: int, default: tuple[float, ...]) -> tuple[float, ...]:
        """Return a list of `n` finite numbers."""
        if name not in self.members:
            return default
        values = self._list(name)
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
        value = self._member(name, {})
        if type(value) is not dict:
            self.fail(name, f"is {_shown(value)}, not an object")
        return Element(value, self, name)

    def objects(self, name: str) -> Sequence[Element]:
        """Return a list of objects, looked at when they are asked for; none if it is missing."""
        return Elements(self._list(name), self, name) if name in self.members else ()

    def extension(self, *names: str) -> Element | None:
        """Return the first of some extensions that the object has; None if it has none."""
        if "extensions" not in self.members:
            return None
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


class Elements(Sequence[Element]):
    """A list of objects of a JSON document; each is looked at when it is asked for.

    Parameters
    ----------
    values : list
    parent : Element
        The object that the list is a member of.
    step : str
        Which member.
    """

    def __init__(self, values: list[Any], parent: Element, step: str) -> None:
        self._values, self._parent, self._step = values, parent, step

    def __len__(self) -> int:
        return len(self._values)

    @overload
    def __getitem__(self, index: int) -> Element: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[Element]: ...

    def __getitem__(self, index: int | slice) -> Element | Sequence[Element]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        return self._element(self._values[index], index)

    def __iter__(self) -> Iterator[Element]:
        return map(self._element, self._values, range(len(self._values)))

    def _element(self, value: Any, index: int) -> Element:
        found = Element(value, self._parent, self._step, index)
        if type(value) is not dict:
            raise InputError(f"{found.place} is {_shown(value)}, not an object")
        return found


def _no_index(value: object, n: int, place: str) -> InputError:
    if type(value) is not int:
        return InputError(f"{place} is {_shown(value)}, not an integer")
    return InputError(f"{place} is {_shown(value)}, but there are {n}")


def _shown(value: object) -> str:
    """Spell a value briefly, in one line."""
    if isinstance(value, (list, dict)):
        return "a list" if isinstance(value, list) else "an object"
    if isinstance(value, int) and abs(value) > LARGEST:
        return "a huge number"
    text = ascii(value)
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}..."
