"""`meshmark segment`."""

from __future__ import annotations

from meshmark.cli.console import say
from meshmark.cli.options import (
    ClipOption,
    FpsOption,
    FramesOption,
    OutputOption,
    SegmenterOption,
    SetOption,
    SourceArgument,
    TrustedOption,
    VariantOption,
    reader_parameters,
)
from meshmark.extension.defaults import DEFAULT_SEGMENTER


def segment(
    source: SourceArgument,
    output: OutputOption,
    segmenter: SegmenterOption = DEFAULT_SEGMENTER,
    settings: SetOption = [],  # noqa: B006 (typer makes a new list each time)
    frames: FramesOption = None,
    clip: ClipOption = None,
    fps: FpsOption = None,
    variant: VariantOption = [],  # noqa: B006
    trusted: TrustedOption = False,
) -> None:
    """Write the parts of SOURCE as GeomSubsets and display colours, to view in usdview."""
    from meshmark.commands.segment import segment_asset, segmenter_from_text, write_segmented
    from meshmark.embedding.outputs import check_output
    from meshmark.sources.reading import read

    asset = read(source, parameters=reader_parameters(clip, fps, variant), isolated=not trusted)
    check_output(output, asset, deliver=False)
    labels = segment_asset(asset, segmenter_from_text(segmenter, settings), frames)
    write_segmented(asset, labels, frames, output)
    for prim, each in labels.items():
        counts = sorted({int(parts.max()) + 1 for parts in each})
        say(f"{prim}: {' to '.join(str(n) for n in {counts[0], counts[-1]})} parts")
    say(f"{output}: written")
