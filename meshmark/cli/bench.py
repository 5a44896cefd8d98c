"""`meshmark bench`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshmark.cli.console import frame_progress, put_json, say, warn
from meshmark.cli.options import (
    FramesOption,
    GeodesicOption,
    JsonOption,
    SeedOption,
    SegmenterOption,
    SetOption,
    TrustedOption,
)
from meshmark.extension.defaults import (
    DEFAULT_GEODESIC,
    DEFAULT_LAYERS,
    DEFAULT_SCHEME,
    DEFAULT_SEGMENTER,
)

if TYPE_CHECKING:
    from meshmark.extension.recipe import Recipe

SOME_CELL_FAILED, PLUGIN_FAILED = 1, 5


def bench(
    sources: Annotated[
        list[str],
        typer.Argument(metavar="SOURCE...", help="Assets to mark.", show_default=False),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for the report; made if missing.")
    ],
    suite: Annotated[
        str, typer.Option(help="tsai2014, liris, animation, leaks, hiding or informed.")
    ],
    schemes: Annotated[
        list[str],
        typer.Option(
            "--scheme",
            help="Watermarking scheme; repeat for more. [default: apex; with --informed, "
            "apex and relief]",
            show_default=False,
        ),
    ] = [],  # noqa: B006 (typer makes a new list each time)
    informed: Annotated[
        bool,
        typer.Option(
            "--informed",
            help="Lay the schemes upon each other, and verify copies beside their original.",
        ),
    ] = False,
    segmenter: SegmenterOption = DEFAULT_SEGMENTER,
    geodesic: GeodesicOption = DEFAULT_GEODESIC,
    settings: SetOption = [],  # noqa: B006
    rows: Annotated[
        list[str],
        typer.Option(
            "--row",
            metavar="LABEL",
            help="Only rows of the suite with this label; * stands for anything. Repeat for more.",
        ),
    ] = [],  # noqa: B006
    attacks: Annotated[
        list[str],
        typer.Option(
            "--attack",
            metavar="NAME:PARAMETER=VALUE,...",
            help="A further cell; repeat for more.",
        ),
    ] = [],  # noqa: B006
    frames: FramesOption = None,
    seed: SeedOption = 0,
    trusted: TrustedOption = False,
    json: JsonOption = False,
) -> None:
    """Mark every SOURCE, attack the copies, verify them, and report."""
    from meshmark.benchmarking.benchmark import run_benchmark
    from meshmark.benchmarking.report_document import failures
    from meshmark.benchmarking.suite_rows import cell_from_text
    from meshmark.benchmarking.suites import Suite, suite_named
    from meshmark.workers.ordered_map import default_jobs

    found = suite_named(suite).only(rows)
    cells = (*found.cells, *(cell_from_text(text) for text in attacks))
    recipes = _recipes(list(dict.fromkeys(schemes)), segmenter, geodesic, settings, informed)
    with frame_progress() as progress:
        document = run_benchmark(
            list(dict.fromkeys(sources)),
            Suite(found.name, cells),
            recipes,
            output,
            informed=informed,
            frames=frames,
            seed=seed,
            trusted=trusted,
            jobs=default_jobs(),
            progress=progress,
        )
    _write(document, output)
    if json:
        put_json(document)
    for line in failures(document):
        warn(line)
    _tell(document, output)
    if code := exit_code(document):
        raise typer.Exit(code)


def _recipes(
    schemes: Sequence[str],
    segmenter: str,
    geodesic: str,
    settings: Sequence[str],
    informed: bool,
) -> Sequence[Recipe]:
    from meshmark.errors import UsageError
    from meshmark.extension.recipe import layers_from_text

    if informed:
        layers = layers_from_text(schemes or DEFAULT_LAYERS, segmenter, geodesic, settings)
        if not layers[-1].informed:
            raise UsageError("--informed needs a scheme that reads copies beside their original")
        return layers
    recipes = recipes_from_text(schemes or [DEFAULT_SCHEME], segmenter, geodesic, settings)
    for recipe in recipes:
        if recipe.informed:
            raise UsageError(f"scheme {recipe.scheme} needs --informed")
    return recipes


def recipes_from_text(
    schemes: Sequence[str], segmenter: str, geodesic: str, settings: Sequence[str]
) -> list[Recipe]:
    """Build a recipe for each scheme; `NAME.PARAMETER=VALUE` of another scheme is not for it."""
    from meshmark.extension.recipe import recipe_from_text

    def others(scheme: str) -> tuple[str, ...]:
        return tuple(f"{name}." for name in schemes if name != scheme)

    return [
        recipe_from_text(
            scheme,
            segmenter,
            geodesic,
            [text for text in settings if not text.startswith(others(scheme))],
        )
        for scheme in schemes
    ]


def _write(document: dict[str, Any], folder: Path) -> None:
    from meshmark.benchmarking.plots import ADVICE, can_plot, draw_plots
    from meshmark.benchmarking.report_tables import page_of
    from meshmark.files.atomic import write_json, write_text

    plots: list[str] = []
    if can_plot():
        plots = draw_plots(document, folder)
    else:
        warn(ADVICE)
    write_json(document, folder / "report.json")
    write_text(page_of(document, plots), folder / "report.md")


def _tell(document: dict[str, Any], folder: Path) -> None:
    rows = document["rows"]
    found = sum(row["verified"] for row in rows)
    control = sum(row["control"]["verified"] for row in rows)
    say(f"{len(rows)} cells: {found} found again; {control} unmarked copies found")
    say(f"{folder / 'report.md'}: written")


def exit_code(document: dict[str, Any]) -> int:
    """Return 0 if every cell ran, 5 if a plugin failed in one, else 1."""
    from meshmark.benchmarking.report_document import failures

    if any(row["plugin_failed"] for row in document["rows"]):
        return PLUGIN_FAILED
    return SOME_CELL_FAILED if failures(document) else 0
