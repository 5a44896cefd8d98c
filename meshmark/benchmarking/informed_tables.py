"""Tables of a benchmark that verified copies beside their original."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from meshmark.benchmarking.markdown import number, table

Row = Mapping[str, Any]

ABOUT_INFORMED = """\
**Reading the tables.** Every copy was verified beside its original, where it lies on it being
found blindly. *Owner* and *recipient* are log10 p of each tried alone, of the recipient who fits
best where there are several, corrected for everything but the number of names. *log10 p* is
corrected for that too, and *found* means that it says p <= {fpr:g}. *Covered* is the share of the
original's surface that the copy covers, *residual* its distance from it over the diagonal, under
the placement. *Seconds* are those of placing and reading. The control is the same attack, with the
same random numbers, on the unmarked asset. *Wrong keys* counts, out of so many random ones, those
with p <= 0.1, 0.01 and 0.001 on the very same evidence, first of the marked copy, then of the
unmarked one.

Where several copies were blended, *recipients* tells how many of those whose copies they were are
found, each tried alone; *innocent* is the lowest log10 p of so many names of nobody, each tried
alone; *blind owner* is log10 p of the owner by the blind layers, without the original, in
{blind_frames} frames of the same copy."""


def informed_tables(rows: Sequence[Row], timings: Sequence[Row]) -> list[str]:
    """Lay out the rows of one asset: all attacks, crowds of recipients once more, the controls."""
    seconds = [row["marked"].get("beside_s") for row in timings]
    return [
        "### Attacks",
        _attacks(rows, seconds),
        *_crowds([row for row in rows if _crowd(row) is not None]),
        _controls(rows),
    ]


def _attacks(rows: Sequence[Row], seconds: Sequence[float | None]) -> str:
    header = ["attack", "per", "owner", "recipient", "log10 p", "found", "covered", "residual"]
    header += ["placed by", "seconds", "control log10 p", "wrong keys", "on control"]
    lines = []
    for row, spent in zip(rows, seconds, strict=True):
        facts, control = row["informed"] or {}, row["control"]
        lines.append(
            [
                row["label"],
                row["per"],
                number(facts.get("owner"), ".1f"),
                number(facts.get("recipient"), ".1f"),
                number(row["log10_p"], ".1f"),
                "could not run" if row["error"] else "yes" if row["verified"] else "**no**",
                number(facts.get("covered"), ".0%"),
                number(facts.get("residual"), ".1e"),
                facts.get("method") or "-",
                number(spent, ".1f"),
                number(control["log10_p"], ".1f"),
                _wrong(facts),
                _wrong(control["informed"] or {}),
            ]
        )
    return table(header, lines)


def _wrong(facts: Row) -> str:
    wrong = facts.get("wrong_keys")
    return "-" if wrong is None else " / ".join(str(count) for count in wrong["at_most"].values())


def _crowd(row: Row) -> int | None:
    """Tell how many names of nobody were tried; None where only one copy was attacked."""
    count = (row["informed"] or {}).get("innocents")
    return None if count is None else int(count)


def _crowds(rows: Sequence[Row]) -> list[str]:
    if not rows:
        return []
    header = ["attack", "recipients", "lowest", "innocent", "owner", "blind owner"]
    lines = []
    for row in rows:
        facts = row["informed"]
        lines.append(
            [
                row["label"],
                f"{facts['recipients_found']} of {facts['recipients']}",
                number(facts["recipient"], ".1f"),
                number(facts["innocent"], ".1f"),
                number(facts["owner"], ".1f"),
                number(facts["blind_owner"], ".1f"),
            ]
        )
    names = max(_crowd(row) or 0 for row in rows)
    return [f"### Crowds, and {names} names of nobody", table(header, lines)]


def _controls(rows: Sequence[Row]) -> str:
    ran = [row["control"] for row in rows if row["control"]["error"] is None]
    if not ran:
        return "No control could run."
    found = sum(control["verified"] for control in ran)
    sides = [row["informed"] for row in rows] + [control["informed"] for control in ran]
    wrong = [facts["wrong_keys"] for facts in sides if facts is not None]
    tried = sum(each["tried"] for each in wrong)
    shares: dict[str, int] = {}
    for each in wrong:
        for share, count in each["at_most"].items():
            shares[share] = shares.get(share, 0) + count
    counts = ", ".join(f"{count} have p <= {share}" for share, count in shares.items())
    lowest = min((each["lowest"] for each in wrong), default=None)
    text = f"Control: {found} of {len(ran)} unmarked copies found."
    text = f"**{text}**" if found else text
    return (
        f"{text} Of {tried} random keys, {counts}; the lowest log10 p is {number(lowest, '.2f')}."
    )
