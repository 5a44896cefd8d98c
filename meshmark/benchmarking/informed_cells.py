"""One cell, informed: attack a copy, and verify it beside its original; what else fits it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from meshmark.arrays import FloatArray, SignArray
from meshmark.benchmarking.cells import FPR, attack_copy, attack_mrms, describe, loaded
from meshmark.benchmarking.marked_copies import MarkedCopy, recipients
from meshmark.benchmarking.subjects import Subject, in_memory
from meshmark.benchmarking.suite_rows import Cell
from meshmark.benchmarking.timing import StageClock
from meshmark.detection.decision import decide, pooled, shares
from meshmark.detection.evidence import Evidence
from meshmark.detection.gathering import gather
from meshmark.detection.informed import gather_informed
from meshmark.detection.pooling import Pool
from meshmark.detection.significance import log10_p_of, log10_p_of_names
from meshmark.detection.verify import judge_all
from meshmark.extension.recipe import Recipe
from meshmark.files.atomic import number
from meshmark.keys import Key
from meshmark.mesh.asset import Asset
from meshmark.mesh.frame_range import spread
from meshmark.workers.pool import one_thread

# Random keys that are tried on the evidence of every cell, and the shares of them that p allows.
WRONG_KEYS = 1000
SHARES = (0.1, 0.01, 0.001)
# Names of nobody that are tried on what a crowd of recipients made.
INNOCENTS = 20_000
# Words that are tried at once: bounds memory.
AT_ONCE = 1000
# Frames of a crowd's copy that the blind layers are looked for in.
BLIND_FRAMES = 4


def run_informed_cell(
    cell: Cell,
    seed: int,
    layers: Sequence[Recipe],
    key: Key,
    copies: Sequence[Subject | MarkedCopy],
    *,
    original: Subject,
    master: MarkedCopy | None,
) -> dict[str, Any]:
    """Attack a copy and verify what is left beside its original, in JSON values.

    Parameters
    ----------
    seed : int
        Of the attack, and of the random keys.
    layers : sequence of Recipe
        Schemes that the copies are marked by.
    copies : sequence of Subject or MarkedCopy
        One for each of the recipients that the attack needs; or the unmarked asset as often.
    original : Subject
        What the copies are made from.
    master : MarkedCopy, optional
        The same as the blind layers left it.

    Raises
    ------
    MeshmarkError
        If the attack or the verification cannot be done.
    """
    clock = StageClock()
    informed = [layer for layer in layers if layer.informed]
    names = recipients(len(copies))
    with clock.stage("read"):
        first, *others = (loaded(copy, cell) for copy in copies)
        asset, source = in_memory(first), in_memory(original.load())
        kept = None if master is None else in_memory(master.load())
    with clock.stage("attack"):
        attacked = in_memory(attack_copy(asset, cell, seed, others), stored=True)
    with clock.stage("beside"):
        found = gather_informed(attacked, source, informed, master=kept)
    with clock.stage("other"), one_thread():
        verdict = decide(
            attacked.source,
            found.items,
            key,
            recipients=names,
            fpr=FPR,
            n_schemes=len(informed),
            notes=found.notes,
        )
        facts = {
            **_fits(found.items, key, names),
            "wrong_keys": _wrong_keys(found.items, seed),
            **_alignment(found.items),
        }
        if cell.others:
            facts |= _crowd(found.items, key, attacked, layers)
    cost = attack_mrms(asset, attacked)
    timings = {f"{stage}_s": round(seconds, 4) for stage, seconds in clock.seconds.items()}
    return {**describe(verdict), "attack_mrms_rel": cost, "informed": facts, "timings": timings}


def _fits(items: Sequence[Evidence], key: Key, names: Sequence[str]) -> dict[str, Any]:
    """Try the owner and every recipient, each as if it were the only one."""
    owner, *others = _of_names(items, key, [None, *names]).tolist()
    return {
        "owner": owner,
        "recipient": min(others),
        "recipients": len(others),
        "recipients_found": int(np.sum(np.array(others) <= np.log10(FPR))),
        "innocents": None,
        "innocent": None,
        "blind_owner": None,
    }


def _wrong_keys(items: Sequence[Evidence], seed: int) -> dict[str, Any]:
    """Count the random keys with p at most each of `SHARES`."""
    longest = max((item.n_chips for item in items), default=0)

    def words(item: Evidence | Pool) -> SignArray:
        """Draw the same words for all meshes; short ones begin like long ones."""
        generator = np.random.default_rng([seed, WRONG_KEYS])
        shape = (WRONG_KEYS, item.n_words, longest)
        drawn = (2 * generator.integers(0, 2, shape, dtype=np.int8) - 1).astype(np.int8)
        return drawn[..., : item.n_chips]

    log10_p = _best(
        items,
        lambda item: log10_p_of(item, words(item)),
        lambda pool: pool.log10_p(words(pool)),
        WRONG_KEYS,
    )
    return {
        "tried": WRONG_KEYS,
        "at_most": {f"{share:g}": int(np.sum(log10_p <= np.log10(share))) for share in SHARES},
        "lowest": float(log10_p.min()),
    }


def _crowd(
    items: Sequence[Evidence], key: Key, attacked: Asset, layers: Sequence[Recipe]
) -> dict[str, Any]:
    """Try names of nobody on what a crowd made, and look for the owner without the original."""
    strangers = [f"innocent {n}" for n in range(INNOCENTS)]
    lowest = min(float(_of_names(items, key, some).min()) for some in _slices(strangers))
    facts: dict[str, Any] = {"innocents": INNOCENTS, "innocent": lowest}
    blind = [layer for layer in layers if not layer.informed]
    if not blind:
        return facts
    few = (mesh.select(spread(len(mesh), BLIND_FRAMES)) for mesh in attacked.meshes)
    evidence = gather(replace(attacked, meshes=tuple(few)), recipes=blind, parts=False)
    return {**facts, "blind_owner": judge_all(evidence, key, fpr=FPR).log10_p}


def _of_names(items: Sequence[Evidence], key: Key, names: Sequence[str | None]) -> FloatArray:
    """Bound log10 p of each name by itself, (n,)."""
    return _best(
        items,
        lambda item: log10_p_of_names(item, key, names),
        lambda pool: pool.log10_p(key.words_of(pool.scheme, pool.n_words, pool.n_chips, names)),
        len(names),
    )


def _best(
    items: Sequence[Evidence],
    log10_p: Callable[[Evidence], FloatArray],
    of_pool: Callable[[Pool], FloatArray],
    n: int,
) -> FloatArray:
    """Bound log10 p of n hypotheses by what fits best, corrected for meshes and schemes, (n,)."""
    best = np.zeros(n)
    schemes = len({item.scheme for item in items})
    for item, share in zip(items, shares(items), strict=True):
        best = np.minimum(best, log10_p(item) - share + np.log10(schemes))
    for pool, share in pooled(items):
        best = np.minimum(best, of_pool(pool) - share + np.log10(schemes))
    return best


def _slices(names: Sequence[str]) -> Iterator[Sequence[str]]:
    return (names[start : start + AT_ONCE] for start in range(0, len(names), AT_ONCE))


def _alignment(items: Sequence[Evidence]) -> dict[str, Any]:
    """Tell how the mesh with the most evidence was laid upon its original."""
    facts = [item.informed for item in items if item.informed is not None]
    if not facts:
        nothing = ("method", "map", "covered", "residual", "patches")
        return dict.fromkeys(nothing)
    most = max(facts, key=lambda each: each.patches)
    return {
        "method": most.method,
        "map": ", ".join(most.maps),
        "covered": number(most.covered),
        "residual": number(most.residual),
        "patches": most.patches,
    }
