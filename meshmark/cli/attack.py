"""`meshmark attack`."""

from __future__ import annotations

from typing import Annotated

import typer

from meshmark.cli.console import say, warn
from meshmark.cli.options import (
    ClipOption,
    FpsOption,
    OutputOption,
    SeedOption,
    SourceArgument,
    TrustedOption,
    VariantOption,
    reader_parameters,
)


def attack(
    name: Annotated[
        str, typer.Argument(help="The attack; see `plugins list`.", show_default=False)
    ],
    source: SourceArgument,
    output: OutputOption,
    parameters: Annotated[
        list[str],
        typer.Option(
            "--parameter",
            "-p",
            metavar="PARAMETER=VALUE",
            help="A parameter of the attack; repeat for more.",
        ),
    ] = [],  # noqa: B006 (typer makes a new list each time)
    seed: SeedOption = 0,
    clip: ClipOption = None,
    fps: FpsOption = None,
    variant: VariantOption = [],  # noqa: B006
    trusted: TrustedOption = False,
) -> None:
    """Modify SOURCE as a thief, a pipeline or an accident would, and write OUTPUT."""
    from meshmark.commands.attack import attack_asset, attack_from_text, write_attacked
    from meshmark.embedding.outputs import check_output
    from meshmark.sources.reading import read

    made = attack_from_text(name, parameters)
    asset = read(source, parameters=reader_parameters(clip, fps, variant), isolated=not trusted)
    check_output(output, asset, deliver=False)
    attacked = attack_asset(asset, made, seed)
    write_attacked(attacked, output)
    for mesh in attacked.meshes:
        for note in mesh.notes:
            warn(f"{mesh.prim}: {note}")
    say(f"{output}: written")
