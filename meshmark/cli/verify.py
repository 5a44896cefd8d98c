"""`meshmark verify`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshmark.cli.console import complain, exit_code, frame_progress, put_json, say, warn
from meshmark.cli.options import (
    ClipOption,
    FpsOption,
    GeodesicOption,
    JsonOption,
    KeyOption,
    SegmenterOption,
    SetOption,
    TrustedOption,
    VariantOption,
    load_key,
    reader_parameters,
    require_taken,
)
from meshmark.errors import MeshmarkError
from meshmark.extension.defaults import DEFAULT_GEODESIC, DEFAULT_SEGMENTER

if TYPE_CHECKING:
    from meshmark.detection.verdict import Named, PrimVerdict, Verdict
    from meshmark.extension.recipe import Recipe
    from meshmark.keys import Key
    from meshmark.mesh.asset import Asset
    from meshmark.workers.progress import MeshProgress

# Of more meshes than this, only those with the lowest p are printed.
MOST_SHOWN = 8


def verify(
    sources: Annotated[
        list[str],
        typer.Argument(metavar="SOURCE...", help="Copies to verify.", show_default=False),
    ],
    key: KeyOption,
    scheme: Annotated[
        list[str],
        typer.Option(
            help="Scheme of the mark, or several; by default those that embed uses, and those "
            "that a manifest beside SOURCE names."
        ),
    ] = [],  # noqa: B006 (typer makes a new list each time)
    segmenter: SegmenterOption = DEFAULT_SEGMENTER,
    geodesic: GeodesicOption = DEFAULT_GEODESIC,
    settings: SetOption = [],  # noqa: B006
    recipient: Annotated[
        list[str],
        typer.Option(
            "--recipient",
            metavar="NAME|@FILE",
            help="A recipient to try (@@NAME for @NAME), or a file of names, one a line; "
            "p is corrected for their number.",
        ),
    ] = [],  # noqa: B006
    frames: Annotated[
        str,
        typer.Option(
            metavar="A:B[:S]|auto",
            help="Time codes from A to B, every S-th frame (`:` looks at everything); auto "
            "samples few frames first, and more only while the answer is open.",
        ),
    ] = "auto",
    original: Annotated[
        str | None,
        typer.Option(
            metavar="SOURCE",
            help="What the copies may have been made from: far more is found beside it.",
        ),
    ] = None,
    master: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="The original as `embed --master` kept it; made again from original and key "
            "without it.",
        ),
    ] = None,
    clip: ClipOption = None,
    fps: FpsOption = None,
    variant: VariantOption = [],  # noqa: B006
    evidence: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Read the evidence from FILE; if it does not exist, measure it and write it.",
        ),
    ] = None,
    unauthenticated: Annotated[
        bool,
        typer.Option(
            "--unauthenticated-evidence",
            help="Report what FILE says although it may be forged; the answer is inconclusive.",
        ),
    ] = False,
    fpr: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Largest p that counts as marked.")
    ] = 1e-6,
    everything: Annotated[
        bool, typer.Option("--all", help="Print every mesh, not only the eight with the lowest p.")
    ] = False,
    trusted: TrustedOption = False,
    json: JsonOption = False,
) -> None:
    """Say whether each SOURCE bears the key's mark, whose copy it is, and the bound on p."""
    from meshmark.errors import UsageError

    if not 0.0 < fpr < 1.0:
        raise UsageError(f"--fpr must lie between 0 and 1, not {fpr:g}")
    if evidence is not None and len(sources) > 1:
        raise UsageError("--evidence holds that of one SOURCE")
    if unauthenticated and evidence is None:
        raise UsageError("--unauthenticated-evidence needs --evidence")
    if master is not None and original is None:
        raise UsageError("--master needs --original")
    parameters = reader_parameters(clip, fps, variant)
    require_taken(parameters, [*sources, *([original] if original else [])])
    request = Request(
        recipes=_recipes(scheme, segmenter, geodesic, settings),
        named=bool(scheme),
        recipients=_names(recipient),
        frames=frames,
        parameters=parameters,
        evidence=evidence,
        authenticated=not unauthenticated,
        fpr=fpr,
        trusted=trusted,
        original=original,
        master=master,
    )
    secret = load_key(key)
    verdicts: list[Verdict] = []
    worst = 0
    for source in sources:
        try:
            verdict = _verify_one(source, secret, request)
        except MeshmarkError as error:
            complain(str(error))
            worst = worst or error.exit_code
            continue
        verdicts.append(verdict)
        _tell(verdict, everything)
        _tell_of_manifest(source)
    if json:
        put_json({"assets": [verdict.as_json() for verdict in verdicts]})
    code = worst or exit_code(verdict.verdict for verdict in verdicts)
    if code:
        raise typer.Exit(code)


def _recipes(
    schemes: Sequence[str], segmenter: str, geodesic: str, settings: Sequence[str]
) -> Sequence[Recipe]:
    from meshmark.errors import UsageError
    from meshmark.extension.recipe import default_layers, layers_from_text, scheme_names

    if schemes:
        return layers_from_text(schemes, segmenter, geodesic, settings)
    if settings:
        raise UsageError(f"--set needs --scheme, one of {', '.join(scheme_names())}")
    return [replace(layer, segmenter=segmenter, geodesic=geodesic) for layer in default_layers()]


@dataclass(frozen=True)
class Request:
    """Options that apply to every source."""

    recipes: Sequence[Recipe]
    named: bool
    recipients: Sequence[str]
    frames: str
    parameters: dict[str, Any]
    evidence: Path | None
    authenticated: bool
    fpr: float
    trusted: bool
    original: str | None
    master: str | None

    def recipes_for(self, source: str) -> Sequence[Recipe]:
        """List what is tried on a source: what was asked for, or else also what its manifest names.

        A scheme of which that says other parameters is to be asked for by whoever knows them.
        """
        from meshmark.embedding.manifest import named_schemes
        from meshmark.extension.recipe import scheme_names

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


def _names(recipients: Sequence[str]) -> list[str]:
    from meshmark.recipients import name_or_file, read_names, spellings

    names: list[str] = []
    for text in recipients:
        named = name_or_file(text)
        names += [named] if isinstance(named, str) else read_names(named)
    return list(spellings(names))


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


def _verify_one(source: str, secret: Any, request: Request) -> Verdict:
    # Not in the thread below as well: two that import the same get in each other's way.
    import meshmark.sources.reading  # noqa: F401
    from meshmark.workers.ordered_map import default_jobs

    with frame_progress() as progress:

        def tell(prim: str, done: int, total: int) -> None:
            progress("verify", prim, done, total)

        if request.evidence is not None:
            from meshmark.detection.evidence_cache import kept_evidence
            from meshmark.detection.verify import judge_all

            found = kept_evidence(
                source,
                request.evidence,
                recipes=request.recipes_for(source),
                frames=request.frames,
                parameters=request.parameters,
                authenticated=request.authenticated,
                isolated=not request.trusted,
                original=request.original,
                master=request.master,
                jobs=default_jobs(),
                progress=tell,
            )
            return judge_all(found, secret, recipients=request.recipients, fpr=request.fpr)
        progress("read", source, 0, 1)
        recipes = request.recipes_for(source)
        blind = [recipe for recipe in recipes if not recipe.informed]
        with nullcontext() if request.trusted else _importing(blind):
            asset = _read(source, request, copy=request.original is not None)
        progress("read", source, 1, 1)
        from meshmark.detection.verify import verify as verify_asset

        original = None
        if request.original is not None:
            original = _read(request.original, request)
        return verify_asset(
            asset,
            secret,
            recipes=recipes,
            recipients=request.recipients,
            frames=request.frames,
            fpr=request.fpr,
            original=original,
            master=None if original is None else _master(original, secret, request, tell),
            jobs=default_jobs(),
            progress=tell,
        )


def _read(source: str, request: Request, *, copy: bool = False) -> Asset:
    """Read a source; copies beside an original need not have its clips and variants."""
    from meshmark.sources.readers import parameters_for
    from meshmark.sources.reading import read

    parameters = parameters_for(source, request.parameters, copy=copy)
    return read(source, parameters=parameters, isolated=not request.trusted)


def _master(original: Asset, secret: Key, request: Request, tell: MeshProgress) -> Any:
    """Read the master, or return what makes it again; None where no blind layer is tried."""
    from meshmark.embedding.asset import embed
    from meshmark.workers.ordered_map import default_jobs

    if request.master is not None:
        return _read(request.master, request, copy=True)
    layers = request.master_layers
    if not layers:
        return None

    def made() -> Asset:
        return embed(original, secret, recipe=layers, jobs=default_jobs(), progress=tell).asset

    return made


def _tell(verdict: Verdict, everything: bool) -> None:
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
