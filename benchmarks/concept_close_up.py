"""Draws how far a mark moved the points of the creature, for docs/concepts.md."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize

from apex_figures import SIZE, linear, picture, save, show
from concept_copies import RED, WIDTH, Copies
from meshmark.arrays import FloatArray, IntArray
from meshmark.demo import creature
from meshmark.metrics import mrms
from render import View

# Width of the close-up of the mark, in root areas, and the fewest points it shows.
CLOSE_UP, FEWEST = 0.11, 40


def draw_mark(copies: Copies, path: Path) -> None:
    """Draw how far points moved, and both versions of a piece of the mesh over each other."""
    P, X, F = copies.frame.points, copies.marked.points, copies.frame.faces
    view, size = copies.view(), float(np.linalg.norm(np.ptp(P, axis=0)))
    move = 100.0 * np.linalg.norm(X - P, axis=1) / size
    print(f"moves: median {np.median(move):.2f} %, largest {move.max():.2f} % of the diagonal")
    print(f"between the surfaces: MRMS {100.0 * mrms(P, F, X, F) / size:.3f} % of the diagonal")
    norm, cmap = Normalize(0.0, float(np.percentile(move, 99.0))), plt.cm.magma_r
    image = picture(
        P, F, move[:, None], lambda v: linear(cmap(norm(v[:, 0]))), view, np.empty((0, 3)), 0.0
    )
    figure, axes = plt.subplots(
        1, 2, figsize=(WIDTH, 3.9), width_ratios=(1.62, 1.0), layout="constrained"
    )
    show(axes[0], image, "how far each point moved")
    bar = figure.colorbar(
        ScalarMappable(norm, cmap), ax=axes[0], location="bottom", shrink=0.7, aspect=40, pad=0.02
    )
    bar.set_label("% of the creature's diagonal", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    centre = close_up_centre(copies, move, view)
    mark_square(axes[0], P[centre], view, copies)
    draw_close_up(axes[1], copies, centre, view)
    save(figure, path)


def half_width(copies: Copies) -> float:
    """Half the width of the close-up, in the unit of the points."""
    return CLOSE_UP / 2.0 * copies.root_area


def close_up_centre(copies: Copies, move: FloatArray, view: View) -> int:
    """Choose the point about which the mark moved points most, on a side that faces the eye."""
    P, half = copies.frame.points, half_width(copies)
    front = facing(copies, view) > 0.5
    mean = np.full(len(P), -1.0)
    for v in np.flatnonzero(front):
        near = np.linalg.norm(P - P[v], axis=1) < half
        if front[near].all() and near.sum() >= FEWEST:
            mean[v] = move[near].mean()
    return int(mean.argmax())


def facing(copies: Copies, view: View) -> FloatArray:
    """Cosine between the normals at the points and the direction towards the eye, (N,)."""
    P, F = copies.frame.points, copies.frame.faces
    area = np.cross(P[F[:, 1]] - P[F[:, 0]], P[F[:, 2]] - P[F[:, 0]])
    normals = np.zeros_like(P)
    np.add.at(normals, F.reshape(-1), np.repeat(area, 3, axis=0))
    return (normals @ view.axes()[2]) / np.linalg.norm(normals, axis=1)


def mark_square(ax, centre: FloatArray, view: View, copies: Copies) -> None:
    scale = SIZE[0] / view.span
    x, y = np.array(SIZE) / 2.0 + (view.axes()[:2] @ (centre - view.center)) * [1, -1] * scale
    half = half_width(copies) * scale
    # White beneath keeps the square visible on dark points.
    for colour, width in (("white", 5), (RED, 2.5)):
        corner, side = (x - half, y - half), 2 * half
        ax.add_patch(plt.Rectangle(corner, side, side, fill=False, ec=colour, lw=width))


def draw_close_up(ax, copies: Copies, centre: int, view: View) -> None:
    P, X, half = copies.frame.points, copies.marked.points, half_width(copies)
    E = quad_edges()
    flat, moved = ((V - P[centre]) @ view.axes()[:2].T for V in (P, X))
    near = (np.abs(flat) < 1.3 * half).all(axis=1) & (facing(copies, view) > 0.2)
    E = E[near[E].all(axis=1)]
    for points, colour, width in ((flat, "0.55", 1.0), (moved, RED, 1.4)):
        ax.add_collection(LineCollection(points[E], colors=colour, linewidths=width))
    ax.set(xlim=(-half, half), ylim=(-half, half), aspect="equal", xticks=[], yticks=[])
    ax.set_title("close-up: original grey, marked red", fontsize=10)
    for spine in ax.spines.values():
        spine.set(color=RED, linewidth=2)


def quad_edges() -> IntArray:
    """Edges of the creature's quads (E, 2), without the diagonals that analysis adds."""
    quads = creature(frames=1)[0].topology.indices.reshape(-1, 4)
    return np.stack([quads, np.roll(quads, -1, axis=1)], axis=2).reshape(-1, 2)
