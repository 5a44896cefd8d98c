"""Which variants of a stage are selected: as it says itself, or as somebody asks for."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from pxr import Sdf, Usd

from meshmark.errors import UsageError

# As paths of Sdf are spelt: SET=NAME for all prims that have the set, or PRIM{SET=NAME}.
_ASKED = re.compile(
    r"(?:(?P<prim>/[^{}]+)\{(?P<s>[^{}=]+)=(?P<n>[^{}=]+)\}|(?P<set>[^/{}=][^{}=]*)=(?P<name>[^{}=]+))"
)
MOST_TOLD = 10
# Sets may lie in variants of others, and these in variants of others again.
DEEPEST = 100


@dataclass(frozen=True, order=True)
class Choice:
    """A variant of a set, on one prim or on all that have the set.

    Parameters
    ----------
    prim : str
        Path of the prim that has the set; empty for all prims that have it.
    set : str
        Name of the variant set.
    name : str
        Name of the variant.
    """

    prim: str
    set: str
    name: str

    def __str__(self) -> str:
        return f"{self.prim}{{{self.set}={self.name}}}" if self.prim else f"{self.set}={self.name}"

    @classmethod
    def parse(cls, text: str) -> Choice:
        """Read one as it is typed.

        Raises
        ------
        UsageError
            If it is neither SET=NAME nor PRIM{SET=NAME}.
        """
        found = _ASKED.fullmatch(text)
        if found is None or not Sdf.Path.IsValidPathString(found["prim"] or "/"):
            raise UsageError(f"a variant is SET=NAME or PRIM{{SET=NAME}}, not {text!r}")
        return cls(found["prim"] or "", found["s"] or found["set"], found["n"] or found["name"])


def chosen(stage: Usd.Stage, asked: Sequence[str], *, strict: bool = True) -> tuple[Choice, ...]:
    """Select what is asked for in the session layer of a stage, and return what that was.

    A set may be there only once a variant of another is selected: the order does not matter. What
    is asked of one prim counts more than what is asked of all, and the last of several counts.

    Parameters
    ----------
    stage : Usd.Stage
        Nobody else's.
    asked : sequence of str
        As `Choice.parse` reads them.
    strict : bool
        Whether all must be there.

    Returns
    -------
    tuple of Choice
        One for each set of a prim, in the order of the stage.

    Raises
    ------
    UsageError
        If no prim has such a variant, or only such as no layer can select: inside an instance.
    """
    wanted = sorted(map(Choice.parse, asked), key=lambda each: each.prim != "")
    selected: dict[tuple[str, str], Choice] = {}
    met: set[Choice] = set()
    for _ in range(DEEPEST):
        found: dict[tuple[str, str], Choice] = {}
        for prim, name, variants in list(_sets(stage)):
            path = str(prim.GetPath())
            for each in wanted:
                if each.prim in ("", path) and each.set == name and each.name in variants:
                    found[path, name] = Choice(path, name, each.name)
                    met.add(each)
        if all(selected.get(key) == choice for key, choice in found.items()):
            break
        selected |= found
        select(stage, found.values())
    missing = [each for each in wanted if each not in met]
    if strict and missing:
        raise _none_such(stage, missing[0])
    return tuple(selected.values())


def select(stage: Usd.Stage, choices: Iterable[Choice]) -> None:
    """Select variants in the session layer of a stage."""
    write_selections(stage.GetSessionLayer(), choices)


def write_selections(layer: Sdf.Layer, choices: Iterable[Choice]) -> None:
    """Let a layer select variants."""
    with Sdf.ChangeBlock():
        for each in choices:
            Sdf.CreatePrimInLayer(layer, each.prim).variantSelections[each.set] = each.name


def selections(prim: Usd.Prim) -> list[tuple[Choice, list[str]]]:
    """List the selected variants on the way to a prim, the outermost first; with the others."""
    found = []
    for path in prim.GetPath().GetPrefixes():
        sets = prim.GetStage().GetPrimAtPath(path).GetVariantSets()
        for name in sets.GetNames():
            selected = sets.GetVariantSelection(name)
            others = [
                each for each in sets.GetVariantSet(name).GetVariantNames() if each != selected
            ]
            if selected:
                found.append((Choice(str(path), name, selected), others))
    return found


def _sets(stage: Usd.Stage) -> Iterator[tuple[Usd.Prim, str, list[str]]]:
    for prim in Usd.PrimRange.AllPrims(stage.GetPseudoRoot()):
        # The pseudo-root has no variants, and no prim inside an instance is in this range.
        sets = prim.GetVariantSets()
        for name in sets.GetNames():
            yield prim, name, sets.GetVariantSet(name).GetVariantNames()


def _none_such(stage: Usd.Stage, asked: Choice) -> UsageError:
    prim = stage.GetPrimAtPath(asked.prim) if asked.prim else None
    if prim and prim.IsInstanceProxy():
        return UsageError(f"{asked}: no layer can select a variant inside an instance")
    known = [
        str(Choice(str(prim.GetPath()), name, each))
        for prim, name, variants in _sets(stage)
        for each in variants
    ]
    more = f" and {len(known) - MOST_TOLD} more" if len(known) > MOST_TOLD else ""
    told = ", ".join(known[:MOST_TOLD]) + more
    return UsageError(f"no variant {asked}; there is {told or 'none'}")
