"""Bit errors and evidence against the strength of attacks, one figure a family."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import chdir
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

Row = Mapping[str, Any]

ADVICE = "matplotlib is not installed, so there are no plots: pip install 'meshmark[plots]'"


def can_plot() -> bool:
    """Tell whether matplotlib is there."""
    return find_spec("matplotlib") is not None


def _load_matplotlib() -> None:
    """Import matplotlib where there is no `matplotlibrc`: it reads one in the working directory."""
    spec = find_spec("matplotlib")
    assert spec is not None
    assert spec.origin is not None
    with chdir(Path(spec.origin).parent):
        import_module("matplotlib")


def draw_plots(document: Mapping[str, Any], folder: Path) -> list[str]:
    """Draw a figure for each family of attacks that has more than one row.

    Returns
    -------
    list of str
        File names, in the folder.
    """
    _load_matplotlib()
    rows = [row for row in document["rows"] if row["error"] is None]
    families = dict.fromkeys(row["family"] for row in rows)
    names = []
    for family in families:
        own = [row for row in rows if row["family"] == family]
        if len({row["label"] for row in own}) > 1:
            names.append(f"{family}.png")
            _draw(own, document, folder / names[-1])
    return names


def _draw(rows: Sequence[Row], document: Mapping[str, Any], path: Path) -> None:
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    labels = list(dict.fromkeys(row["label"] for row in rows))
    figure = Figure(figsize=(10, 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    colors = mpl.color_sequences["tab10"]
    for k, (name, own) in enumerate(_series(rows).items()):
        color = colors[k % len(colors)]
        x = [labels.index(row["label"]) for row in own]
        left.plot(x, _values(own, "ber_avg"), "o-", color=color, label=name)
        left.plot(x, _values(own, "ber_max"), "^:", color=color)
        right.plot(x, _values(own, "log10_p"), "o-", color=color)
        control = [row["control"] for row in own]
        right.plot(x, _values(control, "log10_p"), "x:", color=color)
    left.set(ylabel="BER of the best part (dotted: maximum)")
    left.set_ylim(-0.02, max(0.52, left.get_ylim()[1]))
    right.set(ylabel="log10 p, all frames (dotted: unmarked)")
    right.axhline(math.log10(document["fpr"]), color="0.6", lw=1)
    for axis in (left, right):
        axis.set_xticks(range(len(labels)), labels, rotation=30, ha="right")
    # Below both: many curves leave no place inside.
    figure.legend(loc="outside lower center", ncols=2, fontsize="x-small")
    # A fixed text for what would otherwise be a version: equal runs give equal files.
    figure.savefig(path, dpi=110, metadata={"Software": "meshmark"})


def _series(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Group rows into curves: asset, scheme, per, and which frames."""
    curves: dict[str, list[Row]] = {}
    for row in rows:
        name = f"{row['asset']} {row['scheme']}, per {row['per']}"
        if row["frames"] == "first":
            name += ", first frame"
        curves.setdefault(name, []).append(row)
    return curves


def _values(rows: Sequence[Row], name: str) -> list[float]:
    return [float("nan") if row[name] is None else float(row[name]) for row in rows]
