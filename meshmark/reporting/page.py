"""Facts and view as one HTML page, which asks nothing of any network.

All that is shown may have been written by whoever made the file: names of prims, notes, paths.
Text is escaped by the template; data in scripts hold no `<`; and the policy of the page lets no
other script or style run than its own, whose hashes it names, and fetches nothing.
"""

from __future__ import annotations

import base64
import hashlib
import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from numpy.typing import NDArray

from meshmark.mesh.runs import span
from meshmark.reporting.camera import ANGLE
from meshmark.reporting.chart import chart
from meshmark.reporting.colours import PALETTE, heat_colours
from meshmark.reporting.facts import Facts, Table, shortened
from meshmark.reporting.still import HEIGHT, WIDTH, heat_steps, still
from meshmark.reporting.view import View
from meshmark.reporting.wording import percent, time_code

ASSETS = Path(__file__).parent / "assets"
# Bytes that a page may have.
LARGEST = 2_000_000
# Parts that the legend names, and files that are listed one by one.
MOST_NAMED, MOST_FILES = 8, 300
# Displacements are shown so many times as large at most, and the largest as long as this.
MAGNIFIED, VISIBLE = 200, 0.1


def page(facts: Facts, view: View | None) -> str:
    """Lay out a page.

    Parameters
    ----------
    facts : Facts
        What it says.
    view : View or None
        What it shows in three dimensions; None where there is nothing to be shown.
    """
    style, script = _asset("page.css"), _asset("viewer.js")
    environment = Environment(
        loader=FileSystemLoader(ASSETS), autoescape=True, undefined=StrictUndefined
    )
    environment.filters["chart"] = chart
    return environment.get_template("page.html").render(
        policy=_policy(style, script),
        style=Markup(style),
        script=Markup(script),
        facts=facts,
        view=None if view is None else _shown(view),
        files=_files(facts.files),
    )


@cache
def _asset(name: str) -> str:
    return (ASSETS / name).read_text(encoding="utf-8")


def _policy(style: str, script: str) -> str:
    """Allow this style and this script, pictures inside the page, and nothing else."""
    hashed = (base64.b64encode(hashlib.sha256(text.encode()).digest()) for text in (style, script))
    own_style, own_script = (f"'sha256-{digest.decode()}'" for digest in hashed)
    return (
        f"default-src 'none'; style-src {own_style}; script-src {own_script}; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )


def _files(files: tuple[tuple[str, str], ...]) -> Table:
    """List the hashes of files; of many, those of the first, and one for the list of all."""
    rows = files
    if len(files) > MOST_FILES:
        listed = "".join(f"{digest}  {name}\n" for name, digest in files)
        whole = hashlib.sha256(listed.encode()).hexdigest()
        rows = ((f"this list of all {len(files):,} files, as sha256sum writes it", whole), *files)
    return Table("SHA-256 of every file involved", ("file", "SHA-256"), rows)


def _shown(view: View) -> dict[str, Any]:
    """Return what the template shows of a view."""
    named = list(zip(PALETTE * (1 + len(view.legend)), view.legend, strict=False))
    more = len(named) - MOST_NAMED
    legend = [(colour, shortened(name)) for colour, name in named[:MOST_NAMED]]
    if more > 0:
        legend.append((PALETTE[-1], f"{more:,} more"))
    buttons = [("plain", "Surface"), ("parts", "Parts and anchors")]
    if view.heat is not None:
        buttons.insert(0, ("heat", view.heat.label))
    return {
        "heading": "The marked file" if view.moves is not None else "The file",
        "still": _text(np.frombuffer(still(view), dtype=np.uint8)),
        "width": WIDTH,
        "height": HEIGHT,
        "alt": _alt(view),
        "caption": _caption(view),
        "legend": legend,
        "buttons": buttons,
        "bar": _bar(view),
        "frames": len(view.times),
        "wipe": view.moves is not None,
        "magnify": 1 if view.moves is None else _magnified(view.moves),
        "data": _data(view),
    }


def _alt(view: View) -> str:
    n = view.selection.n_meshes
    what = f"{n:,} meshes" if n > 1 else f"The mesh {shortened(view.legend[0].partition(',')[0])}"
    if view.heat is None:
        return f"{what}, seen from the side."
    median, top = (percent(float(x)) for x in (np.median(view.heat.values), view.heat.top))
    return (
        f"{what}, seen from the side and coloured by {view.heat.label.lower()}: half of the points "
        f"are below {median} of the diagonal, nearly all below {top}."
    )


def _caption(view: View) -> list[str]:
    chosen = view.selection
    shown = sum(len(np.unique(each.points)) for each in chosen.meshes)
    told = [
        f"The view shows {shown:,} of {chosen.n_points:,} points in {len(view.times):,} of "
        f"{chosen.n_frames:,} frames, and follows the mesh; all figures on this page are of all "
        "points."
    ]
    if chosen.n_meshes > len(chosen.meshes):
        told.append(f"It shows {len(chosen.meshes):,} of {chosen.n_meshes:,} meshes.")
    changing = [each for each in chosen.meshes if each.n_runs > 1]
    told += [
        f"The connectivity of {shortened(each.mesh.prim)} changes over time. Of its "
        f"{each.n_runs:,} runs of frames in which it does not, the longest is shown, frames "
        f"{span(each.mesh)}."
        for each in changing[:MOST_NAMED]
    ]
    if len(changing) > MOST_NAMED:
        told.append(f"So does that of {len(changing) - MOST_NAMED:,} more meshes.")
    if len(view.anchors):
        told.append(
            f"{len(view.anchors):,} anchors, tips of the shape about which a blind mark lies, are "
            "shown as red balls."
        )
    return told


def _bar(view: View) -> dict[str, Any] | None:
    if view.heat is None:
        return None
    label, top = view.heat.label, view.heat.top
    marks = [(0, "start", "0"), (180, "middle", percent(top / 2)), (360, "end", percent(top))]
    return {
        "label": f"{label}, of the diagonal of the mesh's box",
        "told": f"Colour bar: {label}, from 0 to {percent(top)} of the diagonal",
        "colours": heat_colours()[::15],
        "marks": marks,
    }


def _magnified(moves: NDArray[np.float64]) -> int:
    largest = float(np.linalg.norm(moves, axis=2).max())
    return MAGNIFIED if largest == 0.0 else int(np.clip(VISIBLE / largest, 1, MAGNIFIED))


def _data(view: View) -> Markup:
    """Write down the arrays of a view for the script that draws them."""
    reach = float(np.abs(view.positions).max())
    positions = np.rint((view.positions / reach + 1.0) / 2.0 * np.iinfo(np.uint16).max)
    told: dict[str, Any] = {
        "times": [f"time code {time_code(time)}" for time in view.times.tolist()],
        "points": view.positions.shape[1],
        "reach": reach,
        "positions": _text(positions.astype("<u2")),
        "faces": _text(view.faces.astype("<u2")),
        "parts": _text((view.parts % len(PALETTE)).astype(np.uint8)),
        "palette": PALETTE,
        "anchors": view.anchors.tolist(),
        "camera": {"position": view.camera.position.tolist(), "angle": ANGLE},
        "heat": None,
        "moves": None,
    }
    if view.heat is not None:
        values = heat_steps(view).astype(np.uint8)
        told["heat"] = {"values": _text(values), "colours": heat_colours()}
    if view.moves is not None:
        largest = float(np.abs(view.moves).max()) or 1.0
        steps = np.rint(view.moves / largest * np.iinfo(np.int8).max).astype(np.int8)
        told["moves"] = {"reach": largest, "values": _text(steps)}
    # Whatever a file is called, a script ends where it is to end.
    return Markup(json.dumps(told, separators=(",", ":")).replace("<", "\\u003c"))


def _text(array: NDArray[Any]) -> str:
    return base64.b64encode(array.tobytes()).decode("ascii")
