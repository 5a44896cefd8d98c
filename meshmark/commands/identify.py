"""Which asset a suspect is a copy of, and whose copy, by all keys and names of a ledger.

The suspect is measured alone, once. All keys and names are tried on that. Then it is laid upon
the originals that it is most like, and what it says beside them is added. Every name is paid for
beside every original it got a copy of, whether or not that original is looked at.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

from meshmark.commands.identification import Candidate, Identification, Request
from meshmark.commands.origin_search import OriginSearch
from meshmark.commands.outcome import Files, Outcome, nobody, outcome_of
from meshmark.detection.verdict import Answer
from meshmark.keys import Key
from meshmark.ledger.origins import Origin
from meshmark.mesh.asset import Asset
from meshmark.sources.digests import source_digests
from meshmark.sources.reading import read
from meshmark.workers.ordered_map import sharing_workers
from meshmark.workers.progress import MeshProgress, StageProgress

# Originals that a suspect is laid upon, unless more are asked for.
MOST = 8


def identify_file(
    source: str, request: Request, progress: StageProgress | None = None
) -> Outcome[Identification]:
    """Identify a suspect. Whatever is wrong with it is part of the outcome.

    Parameters
    ----------
    source : str
        As `meshmark.read` takes it.
    progress : callable, optional
        Told about each stage.
    """
    shown = progress or nobody

    def tell(prim: str, done: int, total: int) -> None:
        shown("identify", prim, done, total)

    def identified() -> tuple[Identification, Files]:
        keys = request.keys()
        suspect = read(source, isolated=not request.trusted)
        files = source_digests(suspect) if request.recorded else ()
        found = identify(
            suspect,
            request.origins,
            keys,
            fpr=request.fpr,
            most=request.most,
            everything=request.everything,
            jobs=request.jobs,
            progress=tell,
        )
        return found, files

    return outcome_of(source, request, identified)


@sharing_workers
def identify(
    suspect: Asset,
    origins: Sequence[Origin],
    keys: Mapping[str, Key],
    *,
    fpr: float = 1e-6,
    most: int = MOST,
    everything: bool = False,
    jobs: int = 1,
    progress: MeshProgress | None = None,
) -> Identification:
    """Say which asset, version and recipient of a ledger a suspect is a copy of.

    Parameters
    ----------
    suspect : Asset
    origins : sequence of Origin
        All that the ledger knows.
    keys : mapping of str to Key
        By key id. Origins of other keys are left out, and told of.
    fpr : float
        Largest p that counts as marked.
    most : int
        Originals that the suspect is laid upon, those first that it is most like.
    everything : bool
        Go on where one was found: a suspect may hold several assets.

    Raises
    ------
    InputError
        If no frame of the suspect can be read.

    Notes
    -----
    The rate is shared evenly among hypotheses, so that p of what is found is multiplied by their
    number (union bound): one for the owner and one for each recipient, alone for each key and
    beside each original. Which originals are looked at may then depend on anything.
    """
    start = time.perf_counter()
    search = OriginSearch(suspect, origins, keys, fpr, jobs, progress)
    candidates = search.alone()
    tried = found = 0
    assets: set[str] = set()
    for known in search.ranked(candidates):
        # Another version of what was found may fit better.
        if (found and not everything and known.origin.asset not in assets) or tried >= most:
            continue
        tried += 1
        candidate = search.beside(known)
        candidates.append(candidate)
        if candidate.by_mark:
            found += 1
            assets.add(known.origin.asset)
    left = len(search.readable) - tried
    notes = [*search.notes]
    if left and not found:
        notes.append(
            f"{left} originals that it is less like were not looked at; --most N looks at more"
        )
    order = sorted(candidates, key=_rank)
    return Identification(
        source=suspect.source,
        verdict=_answer(order, untried=left > 0 or search.left_out > 0),
        candidates=tuple(order),
        hypotheses=search.hypotheses,
        notes=tuple(notes),
        elapsed_s=time.perf_counter() - start,
    )


def _rank(candidate: Candidate) -> tuple[bool, bool, float]:
    """Order candidates: whose mark was read beside the original, who lies on it, by p."""
    marked = candidate.verdict.verdict == "marked"
    return (not candidate.by_mark, not (marked and candidate.by_shape), candidate.verdict.log10_p)


def _answer(candidates: Sequence[Candidate], untried: bool) -> Answer:
    answers = {each.verdict.verdict for each in candidates}
    if "marked" in answers:
        return "marked"
    return "not marked" if "not marked" in answers and not untried else "inconclusive"
