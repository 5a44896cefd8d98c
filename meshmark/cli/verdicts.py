"""What is printed of verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from meshmark.cli.console import complain, say, warn

if TYPE_CHECKING:
    from meshmark.commands.outcome import Outcome
    from meshmark.detection.verdict import Named, PrimVerdict, Verdict

# Of more meshes than this, only those with the lowest p are printed.
MOST_SHOWN = 8


def tell(outcome: Outcome[Verdict], everything: bool = False) -> None:
    """Print what became of a source.

    Parameters
    ----------
    everything : bool
        Print every mesh, not only those with the lowest p.
    """
    if outcome.verdict is None:
        complain(outcome.error)
        return
    _tell_verdict(outcome.verdict, everything)
    _tell_of_manifest(outcome.source)


def _tell_verdict(verdict: Verdict, everything: bool) -> None:
    whose = f", copy of {_names_of(verdict.recipients)}" if verdict.recipient else ""
    say(f"{verdict.source}: {verdict.verdict}{whose}, log10 p {verdict.log10_p:.2f}")
    for pool in verdict.pooled:
        say(f"  {pool.meshes} meshes together by {pool.scheme}: log10 p {pool.log10_p:.2f}")
    shown = sorted(verdict.prims, key=lambda prim: prim.log10_p)
    shown = list(verdict.prims) if everything or len(shown) <= MOST_SHOWN else shown[:MOST_SHOWN]
    whose_differ = len(verdict.recipients) > 1
    for prim in shown:
        _tell_prim(prim, whose_differ)
    if len(shown) < len(verdict.prims):
        say(f"  and {len(verdict.prims) - len(shown)} more meshes that say less: --all shows them")
    for note in verdict.notes:
        warn(note)


def _tell_of_manifest(source: str) -> None:
    from meshmark.embedding.manifest import remark

    said = remark(Path(source))
    if said is not None:
        warn(f"{source}: {said}")


def _tell_prim(prim: PrimVerdict, whose: bool) -> None:
    errors = prim.finding.errors
    # Where nothing was tried there are no bits.
    known = f", BER avg {errors.average:.4f} max {errors.maximum:.4f}"
    told = known if errors.average == errors.average else ""
    names = " + ".join((prim.prim, *prim.also[:1], *(["..."] if len(prim.also) > 1 else [])))
    part = f" ({prim.part})" if prim.part else ""
    copy = f", copy of {_names_of(prim.recipients)}" if whose and prim.recipients else ""
    say(
        f"  {names}{part}: {prim.verdict} by {prim.scheme}{copy}, log10 p {prim.log10_p:.2f}, "
        f"{prim.chips} chips in {len(prim.times)} frames{told}"
    )
    if prim.informed is not None:
        facts = prim.informed.facts
        say(
            f"    beside {facts.prim} of the original: log10 p {prim.informed.log10_p:.2f}, "
            f"{100 * facts.covered:.0f} % of it covered, {facts.patches} chips read, "
            f"off by {facts.residual:.1e} of the diagonal"
        )


def _names_of(recipients: Sequence[Named]) -> str:
    return " and ".join(named.recipient or "the owner" for named in recipients)
