"""What a page says of a copy: the verdict, what it rests on, and what was paid for."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from meshmark.commands.identification import Candidate, Identification
from meshmark.detection.verdict import PrimVerdict, Verdict
from meshmark.reporting.facts import Facts, Section, Series, Table, shortened
from meshmark.reporting.search_facts import cost
from meshmark.reporting.wording import (
    listed,
    log10,
    odds,
    percent,
    this_very_key,
    time_code,
)

# Meshes of which the evidence is shown frame by frame, those with the lowest p.
MOST_CHARTS = 3


@dataclass(frozen=True)
class Asked:
    """What was asked of a copy.

    Parameters
    ----------
    copy : str
        Its name, as it was given.
    key_id : str
    fpr : float
        The largest p that counts as marked.
    original : str or None
        What it was read beside.
    command : str
        What repeats the report, with KEYFILE for the key.
    files : tuple of (str, str)
        Name and SHA-256 of every file involved.
    schemes : tuple of (str, str)
        Name and version of each scheme that was tried.
    """

    copy: str
    key_id: str
    fpr: float
    original: str | None
    command: str
    files: tuple[tuple[str, str], ...]
    schemes: tuple[tuple[str, str], ...]

    @property
    def named(self) -> str:
        """The copy, as it is named in sentences."""
        return shortened(self.copy)


def copy_facts(asked: Asked, verdict: Verdict, found: Identification | None = None) -> Facts:
    """Tell of a verdict, and where a ledger was asked, of what that named."""
    best = None if found is None or found.verdict != "marked" else found.best
    notes = dict.fromkeys((*verdict.notes, *(() if found is None else found.notes)))
    sections = [_evidence(verdict, asked), cost(verdict, found)]
    if found is not None:
        sections.append(_ledger(found))
    if notes:
        sections.append(Section("What could not be looked at, and other notes", notes=tuple(notes)))
    return Facts(
        title=f"Report on {asked.named}",
        kind="Is this file a marked copy?",
        answer=verdict.verdict,
        headline=_headline(verdict, asked, best),
        words=tuple(_words(verdict, asked, best)),
        figures=tuple(_figures(verdict, asked, best)),
        sections=tuple(sections),
        files=asked.files,
        command=asked.command,
        command_note=(
            f"KEYFILE stands for the file of the key with the id {asked.key_id}. The key itself "
            "is nowhere in this report."
        ),
        schemes=asked.schemes,
    )


def _headline(verdict: Verdict, asked: Asked, best: Candidate | None) -> str:
    if verdict.verdict == "not marked":
        return "Not marked: the mark was not found in this file"
    if verdict.verdict == "inconclusive":
        return "Inconclusive: this file cannot answer the question"
    what = f"this is {_what(best)}, " if best is not None and best.origin is not None else ""
    if verdict.recipient is None:
        return f"Marked: {what}{'it' if what else 'this file'} bears the mark of the key's owner"
    return f"Marked: {what}{'the' if what else 'this is the'} copy made for {verdict.recipient}"


def _what(candidate: Candidate) -> str:
    assert candidate.origin is not None
    return f"{candidate.origin.asset} {candidate.origin.version}"


def _words(verdict: Verdict, asked: Asked, best: Candidate | None) -> Iterator[str]:
    """Say what the answer means, and what it does not mean."""
    limit = odds(math.log10(asked.fpr))
    if verdict.verdict == "marked":
        yield (
            f"The file {asked.named} bears a hidden mark that was made with the key "
            f"{asked.key_id}. A key drawn at random would fit it as well with a probability of at "
            f"most {odds(verdict.log10_p)}{this_very_key(verdict.log10_p)}. Everything that was "
            f"tried is counted in this figure. The limit set beforehand is {limit}."
        )
        names = [named.recipient for named in verdict.recipients if named.recipient is not None]
        if len(names) > 1:
            yield (
                f"The words of several recipients are in it: {listed(names)}. A file may be put "
                "together from several copies."
            )
        if best is not None and best.origin is not None:
            entries = best.origin.entries_for(verdict.recipient)
            yield (
                f"The ledger lists it as {_what(best)}"
                + (f", entry {listed([str(each) for each in entries])}." if entries else ".")
            )
        yield (
            "This figure is about chance alone. It does not say who passed the file on, nor when. "
            "It rests on the key being secret: whoever holds the key can make files that bear its "
            "mark."
        )
        return
    beside = (
        f" It was read beside {asked.original}, and alone."
        if asked.original is not None
        else " It was read alone. Beside its original, far more can be found."
    )
    if verdict.verdict == "not marked":
        yield (
            f"The file {asked.named} is large enough to show the mark of the key "
            f"{asked.key_id}, but nothing in it fits that key better than chance allows. The "
            f"limit set beforehand is {limit}.{beside}"
        )
        yield (
            "This does not prove that the file was never marked: a mark can be lost if a file is "
            "changed far enough. Nor does it speak of other keys."
        )
        return
    yield (
        f"The file {asked.named} shows too little to be judged, whether or not it bears the mark "
        f"of the key {asked.key_id}: no key could have reached the limit of {limit}, or the file "
        f"does not fit the original.{beside}"
    )
    yield "This speaks neither for a mark nor against one."


def _figures(verdict: Verdict, asked: Asked, best: Candidate | None) -> Iterator[tuple[str, str]]:
    yield "Answer", verdict.verdict
    yield "Made for", verdict.recipient or ("nobody by name" if best else "not named")
    yield "Probability by chance, at most", odds(verdict.log10_p)
    yield "log10 p", log10(verdict.log10_p)
    yield "Limit (false-positive rate)", odds(math.log10(asked.fpr))
    yield "Key id", asked.key_id


def _evidence(verdict: Verdict, asked: Asked) -> Section:
    ranked = sorted(verdict.prims, key=lambda prim: prim.log10_p)
    shown = [prim for prim in ranked if len(prim.times)][:MOST_CHARTS]
    paragraphs = [
        "What the key says of every frame that was looked at, each by itself. Longer bars speak "
        "more strongly for the mark. These numbers are not corrected yet for what else was tried; "
        "the verdict rests on all frames together."
    ]
    if len(ranked) > len(shown):
        paragraphs.append(f"The {len(shown)} meshes that say most, of {len(ranked)}.")
    frames = tuple(
        Table(
            f"{_name(prim)}, frame by frame",
            ("time code", "log10 p", "bit error rate"),
            tuple(
                (time_code(time), log10(p), percent(ber))
                for time, p, ber in zip(
                    prim.times,
                    prim.finding.log10_p_per_frame.tolist(),
                    prim.finding.errors.per_frame.tolist(),
                    strict=True,
                )
            ),
            (1, 2),
            folded=True,
        )
        for prim in shown
    )
    series = tuple(
        Series(
            _name(prim),
            tuple(map(time_code, prim.times)),
            tuple(prim.finding.log10_p_per_frame.tolist()),
        )
        for prim in shown
    )
    limit = math.log10(asked.fpr)
    if not ranked:
        paragraphs = ["Nothing in the file could be measured."]
    tables = (_meshes(ranked), *frames) if ranked else ()
    return Section(
        "Evidence, frame by frame", tuple(paragraphs), tables=tables, series=series, limit=limit
    )


def _name(prim: PrimVerdict) -> str:
    part = f" ({prim.part})" if prim.part else ""
    return shortened(f"{prim.prim}{part} by {prim.scheme}")


def _meshes(prims: list[PrimVerdict]) -> Table:
    """List what each mesh says, corrected for everything."""
    rows = []
    for prim in prims:
        facts = None if prim.informed is None else prim.informed.facts
        rows.append(
            (
                f"{prim.prim}{f' ({prim.part})' if prim.part else ''}",
                prim.scheme,
                prim.verdict,
                log10(prim.log10_p),
                f"{prim.chips:,}",
                f"{len(prim.times):,}",
                "" if facts is None else percent(facts.covered),
                "" if facts is None else percent(facts.residual),
            )
        )
    return Table(
        "Mesh by mesh, corrected for everything that was tried",
        (
            "mesh",
            "scheme",
            "answer",
            "log10 p",
            "chips",
            "frames",
            "of the original covered",
            "off by (of the diagonal)",
        ),
        tuple(rows),
        (3, 4, 5, 6, 7),
    ).without_empty()


def _ledger(found: Identification) -> Section:
    rows = tuple(
        (
            "alone" if each.origin is None else f"{each.origin.asset} {each.origin.version}",
            each.verdict.verdict,
            log10(each.verdict.log10_p),
            each.verdict.recipient or "",
            "" if each.informed is None else log10(each.informed.log10_p),
            each.why,
        )
        for each in found.candidates
    )
    columns = (
        "laid upon",
        "answer",
        "log10 p",
        "copy of",
        "beside the original alone",
        "not laid upon it because",
    )
    return Section(
        "What the ledger knows",
        (
            "All copies in the ledger that were made with this key were looked for, and the file "
            f"was laid upon the originals it is most like. {found.hypotheses:,} keys, names and "
            "originals are paid for.",
        ),
        tables=(Table("Candidates, the best first", columns, rows, (2, 4)).without_empty(),),
    )
