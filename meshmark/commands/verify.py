"""Verifies one file: the task that one process, many, and a cluster do alike."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

from meshmark.embedding.manifest import named_schemes
from meshmark.errors import DEBUG_VARIABLE, MeshmarkError, UsageError, of_a_bug
from meshmark.extension.recipe import Recipe, default_layers, layers_from_text, scheme_names
from meshmark.keys import Key
from meshmark.mesh.asset import Asset
from meshmark.sources.readers import parameters_for
from meshmark.sources.reading import read
from meshmark.workers.progress import MeshProgress, StageProgress

if TYPE_CHECKING:
    from meshmark.detection.verdict import Verdict


@dataclass(frozen=True, eq=False)
class Request:
    """What is asked of every source.

    It can be pickled and sent anywhere: of the key it knows the file, and the id.

    Parameters
    ----------
    key_file : Path
        Read where a source is verified.
    key_id : str
        Of the key that is to be in it.
    recipes : sequence of Recipe
        Schemes to try.
    named : bool
        Whether these only: or else also those that a manifest beside the source names.
    recipients : sequence of str
        Names to try.
    frames : str
        As of `meshmark.detection.verify.verify`.
    parameters : dict
        Of the readers of source, original and master: each gets those that it takes.
    fpr : float
        Largest p that counts as marked.
    trusted : bool
        Read sources in this process.
    original, master : str, optional
        What sources may have been made from.
    evidence : Path, optional
        File that the evidence is read from, or written to.
    authenticated : bool
        Whether that must bear the seal of the local secret.
    jobs : int
        Processes that the frames of one source are shared among.
    """

    key_file: Path
    key_id: str
    recipes: Sequence[Recipe]
    named: bool
    recipients: Sequence[str] = ()
    frames: str = "auto"
    parameters: dict[str, Any] | None = None
    fpr: float = 1e-6
    trusted: bool = False
    original: str | None = None
    master: str | None = None
    evidence: Path | None = None
    authenticated: bool = True
    jobs: int = 1

    def recipes_for(self, source: str) -> Sequence[Recipe]:
        """List what is tried on a source: what was asked for, or else also what its manifest names.

        A scheme of which that says other parameters is to be asked for by whoever knows them.
        """
        if self.named:
            return self.recipes
        first = self.recipes[0]
        known = {recipe.scheme for recipe in self.recipes}
        told = [name for name in named_schemes(Path(source)) if name not in known]
        there = set(scheme_names()) if told else set()
        others = [replace(first, scheme=name, settings={}) for name in told if name in there]
        return (*self.recipes, *others)

    @property
    def master_layers(self) -> list[Recipe]:
        """What the master is made by."""
        return [recipe for recipe in self.recipes if not recipe.informed]

    def key(self) -> Key:
        """Read the key.

        Raises
        ------
        UsageError
            If the file holds another one here.
        """
        key = Key.load(self.key_file)
        if key.id != self.key_id:
            raise UsageError(
                f"holds the key {key.id} here, not {self.key_id}", source=self.key_file
            )
        return key


def recipes_asked(
    schemes: Sequence[str], segmenter: str, geodesic: str, settings: Sequence[str]
) -> Sequence[Recipe]:
    """Build what was asked for, or what is tried by default."""
    if schemes:
        return layers_from_text(schemes, segmenter, geodesic, settings)
    if settings:
        raise UsageError(f"--set needs --scheme, one of {', '.join(scheme_names())}")
    return [replace(layer, segmenter=segmenter, geodesic=geodesic) for layer in default_layers()]


@dataclass(frozen=True, eq=False)
class Outcome:
    """What became of one source: a verdict, or the reason why there is none.

    Parameters
    ----------
    source : str
    verdict : Verdict or None
    error : str
        In one line; empty if there is a verdict.
    exit_code : int
        Of the error; 0 if there is none.
    """

    source: str
    verdict: Verdict | None = None
    error: str = ""
    exit_code: int = 0


def verify_file(source: str, request: Request, progress: StageProgress | None = None) -> Outcome:
    """Verify a source. Whatever is wrong with it is part of the outcome.

    Parameters
    ----------
    source : str
        As `meshmark.read` takes it.
    progress : callable, optional
        Told about each stage.
    """
    try:
        return Outcome(source, _verdict(source, request, progress or _nobody))
    except MeshmarkError as error:
        return Outcome(source, None, str(error), error.exit_code)
    except Exception as error:
        if os.environ.get(DEBUG_VARIABLE) == "1":
            raise
        return Outcome(source, None, f"{source}: {of_a_bug(error)}", MeshmarkError.exit_code)


def _nobody(stage: str, what: str, done: int, total: int) -> None:
    """Tell nobody."""


def _verdict(source: str, request: Request, progress: StageProgress) -> Verdict:
    def tell(prim: str, done: int, total: int) -> None:
        progress("verify", prim, done, total)

    key = request.key()
    recipes = request.recipes_for(source)
    if request.evidence is not None:
        return _by_evidence(source, request.evidence, key, recipes, request, tell)
    progress("read", source, 0, 1)
    blind = [recipe for recipe in recipes if not recipe.informed]
    with nullcontext() if request.trusted else _importing(blind):
        asset = _read(source, request, copy=request.original is not None)
    progress("read", source, 1, 1)
    from meshmark.detection.verify import verify

    beside = request.original is not None
    return verify(
        asset,
        key,
        recipes=recipes,
        recipients=request.recipients,
        frames=request.frames,
        fpr=request.fpr,
        original=_original(request) if beside else None,
        master=_master(request, key, tell) if beside else None,
        jobs=request.jobs,
        progress=tell,
    )


def _by_evidence(
    source: str,
    evidence: Path,
    key: Key,
    recipes: Sequence[Recipe],
    request: Request,
    tell: MeshProgress,
) -> Verdict:
    from meshmark.detection.evidence_cache import kept_evidence
    from meshmark.detection.verify import judge_all

    found = kept_evidence(
        source,
        evidence,
        recipes=recipes,
        frames=request.frames,
        parameters=request.parameters,
        authenticated=request.authenticated,
        isolated=not request.trusted,
        original=request.original,
        master=request.master,
        jobs=request.jobs,
        progress=tell,
    )
    return judge_all(found, key, recipients=request.recipients, fpr=request.fpr)


@contextmanager
def _importing(recipes: Sequence[Recipe]) -> Iterator[None]:
    """Import what measuring needs during a block that waits for another process."""
    thread = Thread(target=_import, args=(recipes,))
    thread.start()
    try:
        yield
    finally:
        thread.join()


def _import(recipes: Sequence[Recipe]) -> None:
    import meshmark.detection.verify  # noqa: F401

    for recipe in recipes:
        # What is wrong with one is said where it is used.
        with suppress(MeshmarkError):
            recipe.build()


def _read(source: str, request: Request, *, copy: bool = False) -> Asset:
    """Read a source; copies beside an original need not have its clips and variants."""
    parameters = parameters_for(source, request.parameters or {}, copy=copy)
    return read(source, parameters=parameters, isolated=not request.trusted)


def _original(request: Request) -> Asset:
    original = request.original
    assert original is not None
    return _once(request, "original", lambda: _read(original, request))


def _master(request: Request, key: Key, tell: MeshProgress) -> Any:
    """Read the master, or return what makes it again; None where no blind layer is tried."""
    master, layers = request.master, request.master_layers
    if master is not None:
        return _once(request, "master", lambda: _read(master, request, copy=True))
    if not layers:
        return None
    from meshmark.embedding.asset import embed

    def made() -> Asset:
        original = _original(request)
        return embed(original, key, recipe=layers, jobs=request.jobs, progress=tell).asset

    return lambda: _once(request, "master", made)


# Of a request, all sources are read beside the same.
_beside: WeakKeyDictionary[Request, dict[str, Asset]] = WeakKeyDictionary()


def _once(request: Request, name: str, make: Callable[[], Asset]) -> Asset:
    held = _beside.setdefault(request, {})
    if name not in held:
        held[name] = make()
    return held[name]
