"""Verifies one file: the task that one process, many, and a cluster do alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

from meshmark.commands.importing import importing
from meshmark.commands.outcome import Files, Outcome, nobody, outcome_of
from meshmark.commands.verification import Request
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key
from meshmark.mesh.asset import Asset
from meshmark.sources.digests import source_digests
from meshmark.sources.readers import parameters_for
from meshmark.sources.reading import read
from meshmark.workers.progress import MeshProgress, StageProgress

if TYPE_CHECKING:
    from meshmark.detection.evidence_cache import Keeper
    from meshmark.detection.verdict import Verdict


def verify_file(
    source: str, request: Request, progress: StageProgress | None = None
) -> Outcome[Verdict]:
    """Verify a source. Whatever is wrong with it is part of the outcome.

    Parameters
    ----------
    source : str
        As `meshmark.read` takes it.
    progress : callable, optional
        Told about each stage.
    """
    return outcome_of(source, request, lambda: _verdict(source, request, progress or nobody))


def _verdict(source: str, request: Request, progress: StageProgress) -> tuple[Verdict, Files]:
    """Return what a source says, and the files that it was read from, if they are recorded."""
    key = request.key()
    recipes = request.recipes_for(source)
    if request.evidence is not None or request.store is not None:
        return _by_evidence(source, key, recipes, request, _teller(progress))
    progress("read", source, 0, 1)
    blind = [recipe for recipe in recipes if not recipe.informed]
    with nullcontext() if request.trusted else importing(blind):
        asset = _read(source, request, copy=request.original is not None)
    progress("read", source, 1, 1)
    # Of what is trusted they are read twice.
    files = source_digests(asset) if request.recorded else ()
    return verify_asset(asset, request, progress), files


def verify_asset(asset: Asset, request: Request, progress: StageProgress | None = None) -> Verdict:
    """Verify a source that was read.

    Parameters
    ----------
    asset : Asset
    request : Request
    progress : callable, optional
        Told about each stage.
    """
    from meshmark.detection.verify import verify

    key, tell = request.key(), _teller(progress or nobody)
    beside = request.original is not None
    return verify(
        asset,
        key,
        recipes=request.recipes_for(asset.source),
        recipients=request.recipients,
        frames=request.frames,
        fpr=request.fpr,
        original=original_of(request) if beside else None,
        master=_master(request, key, tell) if beside else None,
        jobs=request.jobs,
        progress=tell,
    )


def _teller(progress: StageProgress) -> MeshProgress:
    def tell(prim: str, done: int, total: int) -> None:
        progress("verify", prim, done, total)

    return tell


def original_of(request: Request) -> Asset:
    """Read the original that sources are verified beside, once for all of them."""
    original = request.original
    assert original is not None
    return _once(request, "original", lambda: _read(original, request))


def _by_evidence(
    source: str,
    key: Key,
    recipes: Sequence[Recipe],
    request: Request,
    tell: MeshProgress,
) -> tuple[Verdict, Files]:
    from meshmark.detection.evidence_cache import kept_evidence
    from meshmark.detection.verify import judge_all

    found = kept_evidence(
        source,
        _keeper(request),
        recipes=recipes,
        frames=request.frames,
        parameters=request.parameters,
        isolated=not request.trusted,
        original=request.original,
        master=request.master,
        jobs=request.jobs,
        progress=tell,
    )
    verdict = judge_all(found, key, recipients=request.recipients, fpr=request.fpr)
    return verdict, found.files if request.recorded else ()


def _keeper(request: Request) -> Keeper:
    """Return what keeps evidence: a file, or a store."""
    if request.store is not None:
        from meshmark.detection.evidence_store import EvidenceStore

        return EvidenceStore(request.store)
    from meshmark.detection.evidence_cache import EvidenceFile

    assert request.evidence is not None
    return EvidenceFile(request.evidence, request.authenticated)


def _read(source: str, request: Request, *, copy: bool = False) -> Asset:
    """Read a source; copies beside an original need not have its clips and variants."""
    parameters = parameters_for(source, request.parameters, copy=copy)
    return read(source, parameters=parameters, isolated=not request.trusted)


def _master(request: Request, key: Key, tell: MeshProgress) -> Any:
    """Read the master, or return what makes it again; None where no blind layer is tried."""
    master, layers = request.master, request.master_layers
    if master is not None:
        return _once(request, "master", lambda: _read(master, request, copy=True))
    if not layers:
        return None
    from meshmark.embedding.asset import embed

    def made() -> Asset:
        original = original_of(request)
        return embed(original, key, recipe=layers, jobs=request.jobs, progress=tell).asset

    return lambda: _once(request, "master", made)


# Of a request, all sources are read beside the same.
_beside: WeakKeyDictionary[Request, dict[str, Asset]] = WeakKeyDictionary()


def _once(request: Request, name: str, make: Callable[[], Asset]) -> Asset:
    held = _beside.setdefault(request, {})
    if name not in held:
        held[name] = make()
    return held[name]
