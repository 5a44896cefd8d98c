"""What a page says of all that was tried, and what each of it costs."""

from __future__ import annotations

import math
from collections.abc import Iterator

from meshmark.commands.identification import Identification
from meshmark.detection.joint_verdict import TRIPLE
from meshmark.detection.searched import Searched
from meshmark.detection.verdict import Verdict
from meshmark.reporting.facts import Section, Table
from meshmark.reporting.wording import factor, listed, log10

RESTORED = {
    "none": "as it is",
    "most": "as it is, and with the most smoothing undone",
    "all": "as it is, and with smoothing undone",
}
ENDED = {
    "marked": "The last look found the mark, and no more was needed.",
    "no hope": "No more looks were taken, because the first ones left no hope of a mark.",
    "all seen": "Everything that was asked for was looked at.",
}
# Differences of log10 p below this are of rounding.
ROUNDING = 1e-9


def cost(verdict: Verdict, found: Identification | None) -> Section:
    """Tell what was tried, and what p was multiplied by for each."""
    searches = [_searches(each, found) for each in verdict.searched]
    return Section(
        "What was searched, and what it cost",
        tuple(_words(verdict, found)),
        tables=(*searches, *_pooled(verdict), *_looks(verdict)),
    )


def _words(verdict: Verdict, found: Identification | None) -> Iterator[str]:
    yield (
        "Whoever tries a thousand locks finds one sooner that a wrong key opens. So each search "
        "raises the bound: p is multiplied by the number of things tried, or divided by the share "
        "of the limit that the one which fits best may spend. The verdict's bound is after this."
    )
    best = min((each.log10_p + _paid(each, found) for each in verdict.searched), default=0.0)
    if verdict.original is not None and abs(verdict.log10_p - min(0.0, best)) > ROUNDING:
        yield (
            "Beside an original, three bounds compete: what the file says beside it, what it says "
            f"alone, and both together. The best counts, {factor(TRIPLE)} for three, even where "
            "the first decides and the file need not be looked at alone."
        )
    if verdict.ended is not None:
        yield ENDED[verdict.ended]


def _paid(searched: Searched, found: Identification | None) -> float:
    """Return log10 of what all of a ledger costs more than the names beside one original."""
    return 0.0 if found is None else math.log10(found.hypotheses / searched.names)


def _searches(searched: Searched, found: Identification | None) -> Table:
    where = "beside the original" if searched.beside else "alone"
    names, what = searched.names, "names: the owner and recipients, in every spelling"
    if found is not None:
        names, what = found.hypotheses, "keys, names and originals of the ledger"
    tried = [
        ("schemes, ways to look for a mark", searched.schemes, float(searched.schemes)),
        (what, names, float(names)),
        (
            "meshes, parts of them, and meshes together",
            searched.candidates,
            1.0 / searched.candidate_share,
        ),
    ]
    rows = [(name, f"{number:,}", factor(math.log10(x))) for name, number, x in tried]
    if searched.look_share < 1.0:
        rows.append(("looks at more and more frames", "", factor(-math.log10(searched.look_share))))
    more = _paid(searched, found)
    rows.append(("all of it", "", factor(searched.log10_factor + more)))
    return Table(
        f"What was tried {where}; the bound that came of it: log10 p "
        f"{log10(min(0.0, searched.log10_p + more))}",
        ("what was tried", "how many", "p is multiplied by"),
        tuple(rows),
        (1, 2),
    )


def _pooled(verdict: Verdict) -> Iterator[Table]:
    if verdict.pooled:
        yield Table(
            "What several meshes say together",
            ("scheme", "meshes or surfaces", "log10 p"),
            tuple(
                (each.scheme, f"{each.meshes:,}", log10(each.log10_p)) for each in verdict.pooled
            ),
            (1, 2),
        )


def _looks(verdict: Verdict) -> Iterator[Table]:
    if verdict.looks:
        yield Table(
            "Looks at the file alone, in their order",
            ("look", "scheme", "frames", "the mesh", "log10 p"),
            tuple(
                (
                    f"{number}",
                    listed(look.schemes),
                    f"{look.frames:,}",
                    RESTORED[look.restored],
                    log10(look.log10_p),
                )
                for number, look in enumerate(verdict.looks, start=1)
            ),
            (2, 4),
        )
