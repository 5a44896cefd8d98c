"""Draws the figures of docs/apex.md: anchors, chips and displacements of one animation.

    python benchmarks/apex_figures.py [--source FILE] [-o FOLDER] [--azimuth DEGREES]

Without a source, the demonstration's creature is drawn. Of a source, its first mesh is.
"""

from __future__ import annotations

import argparse
import io
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray
from PIL import Image as PilImage
from scipy.spatial import ConvexHull

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.patheffects import withStroke

from measuring import REPOSITORY
from meshmark import Key, MeshAnimation, read
from meshmark.arrays import FloatArray, IntArray
from meshmark.demo import creature
from meshmark.mesh.topology import edges
from meshmark.mesh.welding import Welding
from meshmark.workers.ordered_map import default_jobs
from meshmark_plugins.schemes.apex.anchors.geodesics import GeodesicDistances
from meshmark_plugins.schemes.apex.anchors.integral_distance import integral_distance
from meshmark_plugins.schemes.apex.anchors.track import FrameAnchors
from meshmark_plugins.schemes.apex.marking.marked_anchors import MarkedAnchors, field_chips
from meshmark_plugins.schemes.apex.marking.plan import plan_animation, require_capacity
from meshmark_plugins.schemes.apex.marking.pose_constraints import chip_targets
from meshmark_plugins.schemes.apex.scheme import Apex
from render import CLAY, View, render_frame

# Pixels of one picture of the shape; rays in between make its edges smooth.
SIZE = (660, 430)
# Halvings of the triangles' sides before they are coloured: bands do not follow triangles.
HALVINGS = 2
# Radius of the ball that stands for an anchor, in root areas.
BALL = 0.018
COLOURS = 192
DPI = 100
RED, BLUE, GREY = "#c0392b", "#2c6fbb", "#b9b9b9"


@dataclass(frozen=True, eq=False)
class Subject:
    """An animation as analysis sees it, its anchors, and what marking makes of it."""

    animation: MeshAnimation
    anchors: MarkedAnchors
    words: IntArray
    scheme: Apex
    marked: dict[int, FloatArray]
    view: View

    def distances(self, P: FloatArray, F: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Distances (C, N) from the anchors in units, chips and their counts (C, K)."""
        parameters, C = self.scheme.parameters, len(self.anchors.vertices)
        H = np.full((C, len(P)), np.inf)
        s = np.full((C, parameters.bins), np.nan)
        n = s.copy()
        for rows, field in self.anchors.fields(P, F):
            unit = float(self.anchors.units[rows[0]])
            H[np.ix_(rows, field.component.vertices)] = field.H / unit
            s[rows], n[rows], _ = field_chips(field, unit, parameters.bins, parameters.width)
        return H, s, n


def subject_of(source: str | None, azimuth: float) -> Subject:
    asset = None if source is None else read(source)
    animation = creature() if asset is None else asset.meshes[0]
    animation = animation.map(Welding.of(animation[0]).frame)
    scheme, jobs = Apex(), default_jobs()
    anchors = require_capacity(FrameAnchors(animation, jobs), scheme.parameters)
    words = Key(bytes(range(32))).words("apex", scheme.n_words, scheme.n_chips)
    plan = plan_animation(animation, words, scheme.parameters, jobs)
    shown = (0, len(animation) // 3)
    marked = {t: plan.mark(t, animation[t]) for t in shown}
    up_axis = "Y" if asset is None else asset.up_axis
    view = View(azimuth=azimuth, elevation=14.0, up_axis=up_axis)
    return Subject(animation, anchors, words[anchors.words], scheme, marked, view)


def halved(F: IntArray, values: FloatArray) -> tuple[IntArray, FloatArray]:
    """Cut every triangle into four; `values` (N, k) at new vertices are means."""
    E = edges(F)
    n = len(values)
    code = np.sort(E, axis=1) @ [n, 1]
    order = np.argsort(code)
    sides = np.sort(np.stack([F[:, [0, 1]], F[:, [1, 2]], F[:, [2, 0]]], axis=1), axis=2)
    ab, bc, ca = (n + order[np.searchsorted(code[order], sides @ [n, 1])]).T
    a, b, c = F.T
    finer = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    cut = np.concatenate([np.stack(corners, axis=1) for corners in finer])
    return cut, np.concatenate([values, values[E].mean(axis=1)])


def ball(centre: FloatArray, radius: float) -> tuple[FloatArray, IntArray]:
    n = np.arange(400)
    z, turn = 1.0 - (2.0 * n + 1.0) / len(n), np.pi * (3.0 - np.sqrt(5.0)) * n
    flat = np.sqrt(1.0 - z**2)
    V = np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)
    return centre + radius * V, ConvexHull(V).simplices


def picture(
    V: FloatArray, F: IntArray, values: FloatArray, paint, view: View, balls: FloatArray, r: float
) -> NDArray[np.uint8]:
    """Render a mesh; `paint` makes colours (F, 3) of the values (F, k) of the triangles."""
    fine = np.concatenate([V, values], axis=1)
    for _ in range(HALVINGS):
        F, fine = halved(F, fine)
    points, colors = fine[:, :3], paint(fine[:, 3:][F].mean(axis=1))
    for centre in balls:
        B, G = ball(centre, r)
        F = np.concatenate([F, G + len(points)])
        points = np.concatenate([points, B])
        colors = np.concatenate([colors, np.full((len(G), 3), linear(RED))])
    return render_frame(points, F, colors=colors, view=view, size=SIZE)


def linear(colours) -> FloatArray:
    """Turn colours as matplotlib gives them into what the renderer shades, (..., 3)."""
    return np.asarray(mpl.colors.to_rgba_array(colours))[:, :3] ** 2.2


def framed(subject: Subject, *poses: FloatArray) -> View:
    """Hold the camera still over several poses."""
    every = np.concatenate(poses)
    centre = (every.min(axis=0) + every.max(axis=0)) / 2.0
    seen = (every - centre) @ subject.view.axes().T
    half = 1.06 * max(np.abs(seen[:, 0]).max(), np.abs(seen[:, 1]).max() * SIZE[0] / SIZE[1])
    return View(
        subject.view.azimuth,
        subject.view.elevation,
        tuple(centre),
        2.0 * half,
        subject.view.up_axis,
    )


def draw_anchors(subject: Subject, path: Path) -> None:
    """Draw the function whose maxima are the anchors, and the bins about them."""
    frame = subject.animation[0]
    P, F = frame.points, frame.faces
    H, *_ = subject.distances(P, F)
    geodesics = GeodesicDistances(P, F)
    f = integral_distance(P, F, geodesics)
    view, r, tips = framed(subject, P), BALL * geodesics.root_area, P[subject.anchors.vertices]
    norm = Normalize(f.min(), f.max())
    left = picture(
        P, F, f[:, None], lambda v: linear(plt.cm.YlGnBu_r(norm(v[:, 0]))), view, tips, r
    )
    K, width = subject.scheme.parameters.bins, subject.scheme.parameters.width
    hues = linear(plt.cm.tab10(np.arange(len(H)) % 10))

    def bands(v: FloatArray) -> FloatArray:
        nearest = v.argmin(axis=1)
        k = np.floor(v.min(axis=1) / width - 1.0)
        shade = np.where(k % 2 == 0, 0.75, 0.25)[:, None]
        colour = shade * hues[nearest] + (1.0 - shade) * 0.9
        return np.where(((k >= 0) & (k < K))[:, None], colour, CLAY)

    reach = np.where(np.isfinite(H), H, 10.0)
    right = picture(P, F, reach.T, bands, view, tips, r)
    figure, axes = plt.subplots(1, 2, figsize=(2 * SIZE[0] / DPI, SIZE[1] / DPI + 0.3))
    titles = (
        "mean distance to the whole surface; maxima are anchors",
        f"bins of {width:g} units about each anchor",
    )
    for ax, image, title in zip(axes, (left, right), titles, strict=True):
        show(ax, image, title)
    for c, (x, y) in enumerate(on_picture(tips, view), start=1):
        gaps = [x, y] - np.delete(on_picture(tips, view), c - 1, axis=0)
        away = (gaps / np.linalg.norm(gaps, axis=1, keepdims=True) ** 3).sum(axis=0)
        dx, dy = 20.0 * away / max(float(np.linalg.norm(away)), 1e-12)
        halo = [withStroke(linewidth=3, foreground="white")]
        axes[1].text(x + dx, y + dy, f"{c}", color=RED, ha="center", va="center", path_effects=halo)
    save(figure, path)


def on_picture(points: FloatArray, view: View) -> FloatArray:
    """Pixels (n, 2) at which points (n, 3) are seen."""
    seen = (points - view.center) @ view.axes().T
    return np.array(SIZE) / 2.0 + seen[:, :2] * [1, -1] * (SIZE[0] / view.span)


def draw_chips(subject: Subject, path: Path) -> None:
    """Draw every chip before and after marking, and where its word wants it."""
    frame = subject.animation[0]
    _, before, n = subject.distances(frame.points, frame.faces)
    _, after, _ = subject.distances(subject.marked[0], frame.faces)
    target, C = chip_targets(n, subject.scheme.parameters.strength), len(subject.anchors.vertices)
    rows = -(-C // 2)
    figure, axes = plt.subplots(
        rows, 2, figsize=(9.4, 1.45 * rows + 0.7), sharex=True, sharey=True, squeeze=False
    )
    k = np.arange(1, before.shape[1] + 1)
    for c, ax in enumerate(axes.T.ravel()):
        if c >= C:
            ax.set_visible(False)
            continue
        right = np.sign(after[c]) == subject.words[c]
        ax.hlines(target[c] * subject.words[c], k - 0.42, k + 0.42, color="0.2", lw=1.2)
        ax.bar(k - 0.19, before[c], 0.36, color=GREY)
        ax.bar(k + 0.19, after[c], 0.36, color=np.where(right, BLUE, RED))
        ax.axhline(0.0, color="0.3", lw=0.6)
        ax.set_title(f"anchor {c + 1}", fontsize=9, loc="left", pad=2)
        ax.spines[["top", "right"]].set_visible(False)
        ax.tick_params(labelsize=8)
    axes[0, 0].set_xticks(k)
    for ax in axes[-1]:
        ax.set_xlabel("bin", fontsize=9)
    handles = [
        plt.Rectangle((0, 0), 1, 1, color=GREY),
        plt.Rectangle((0, 0), 1, 1, color=BLUE),
        plt.Rectangle((0, 0), 1, 1, color=RED),
        plt.Line2D([], [], color="0.2", lw=1.2),
    ]
    labels = ["chip before", "after, sign as the word's", "after, sign wrong", "target"]
    figure.legend(handles, labels, ncol=4, fontsize=9, frameon=False, loc="upper center")
    figure.tight_layout(rect=(0, 0, 1, 1 - 0.3 / figure.get_figheight()))
    save(figure, path, tight=False)
    told = (np.sign(s) == subject.words for s in (before, after))
    print("chips of the word's sign, before and after:", *(f"{t.sum()}/{t.size}" for t in told))


def draw_displacement(subject: Subject, path: Path) -> None:
    """Draw how far vertices moved, in two poses."""
    P = [subject.animation[t].points for t in subject.marked]
    X = list(subject.marked.values())
    F = subject.animation[0].faces
    view = framed(subject, *P)
    diagonal = float(np.linalg.norm(np.ptp(P[0], axis=0)))
    moves = [np.linalg.norm(b - a, axis=1) / diagonal for a, b in zip(P, X, strict=True)]
    every = np.concatenate(moves)
    norm = Normalize(0.0, float(np.percentile(every, 99.0)))
    print(f"displacement / diagonal: median {np.median(every):.1e}, largest {every.max():.1e}")
    cmap = plt.cm.magma_r
    figure, axes = plt.subplots(1, 2, figsize=(2 * SIZE[0] / DPI + 0.9, SIZE[1] / DPI + 0.3))
    for ax, t, V, move in zip(axes, subject.marked, P, moves, strict=True):
        image = picture(
            V, F, move[:, None], lambda v: linear(cmap(norm(v[:, 0]))), view, np.empty((0, 3)), 0.0
        )
        show(ax, image, f"frame {subject.animation.times[t]:g}")
    bar = figure.colorbar(ScalarMappable(norm, cmap), ax=axes, fraction=0.02, pad=0.01)
    bar.set_label("displacement / diagonal", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    bar.formatter.set_powerlimits((0, 0))
    save(figure, path)


def show(ax, image: NDArray[np.uint8], title: str) -> None:
    ax.imshow(image)
    ax.set_axis_off()
    ax.set_title(title, fontsize=10)


def save(figure, path: Path, tight: bool = True) -> None:
    """Write a figure with few colours: a page loads it, and nobody counts them."""
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=DPI, bbox_inches="tight" if tight else None, pad_inches=0.05)
    plt.close(figure)
    image = PilImage.open(buffer).convert("RGB")
    image.quantize(COLOURS, dither=PilImage.Dither.NONE).save(path, optimize=True)
    print(f"{path}: {path.stat().st_size / 1000:.0f} kB")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--source", help="a USD file; the demonstration's creature by default")
    parser.add_argument("--azimuth", type=float, default=30.0)
    parser.add_argument("-o", "--output", type=Path, default=REPOSITORY / "docs" / "apex")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    subject = subject_of(options.source, options.azimuth)
    draw_anchors(subject, options.output / "anchors.png")
    draw_chips(subject, options.output / "chips.png")
    draw_displacement(subject, options.output / "displacement.png")


if __name__ == "__main__":
    main()
