"""Draws the pictures of docs/concepts.md from the demonstration's creature and real keys.

    python benchmarks/concept_figures.py [-o FOLDER]

Every figure is measured: the mark as `embed` makes it, words as keys derive them, evidence as
`verify` measures it on one frame.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.colors import ListedColormap

from apex_figures import BALL, linear, on_picture, picture, save, show, subject_of
from concept_close_up import draw_mark
from concept_copies import RED, WIDTH, Copies
from measuring import REPOSITORY
from meshmark import Key
from meshmark.arrays import FloatArray, IntArray
from meshmark.detection.decision import decide, shares
from meshmark.detection.evidence import Evidence
from meshmark.detection.gathering import gather
from meshmark.extension.recipe import Recipe
from meshmark.extension.registry import make_attack
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.statistics.p_values import word_log_e_means
from render import CLAY

# The key the creature is marked with, and another; both are public, for pictures only.
KEY, OTHER_KEY = Key(bytes(range(32))), Key(bytes(range(32, 64)))
RECIPIENTS = ("acme", "globex")
N_KEYS = 1000
LIMIT = 6  # decades: one in a million
MINUS, PLUS = "#e08a1e", "#2c6fbb"
DARK, GREEN = "0.25", "#3a8f4d"
SIGNS = ListedColormap([MINUS, PLUS])


def evidence_of(frame: Frame) -> list[Evidence]:
    """Measure a frame by itself, as a leaked copy would be."""
    animation = MeshAnimation.from_frames([frame])
    return list(gather(animation, recipes=[Recipe("apex")], restored=False).items)


def draw_key(copies: Copies, path: Path) -> None:
    """Draw the words of two keys."""
    mine, other = copies.words(KEY), copies.words(OTHER_KEY)
    same = int((mine == other).sum())
    figure, axes = plt.subplots(1, 2, figsize=(WIDTH, 3.0), layout="constrained", sharey=True)
    for ax, words, title in (
        (axes[0], mine, "your key"),
        (axes[1], other, f"another key: {same} of {mine.size} signs happen to agree"),
    ):
        show_words(ax, words)
        ax.set_title(title, fontsize=10)
        ax.set_xlabel("ring about the tip", fontsize=9)
    axes[0].set_yticks(np.arange(len(mine)) + 0.5, [f"tip {c + 1}" for c in range(len(mine))])
    legend_of_signs(figure)
    save(figure, path)


def show_words(ax, words: IntArray) -> None:
    ax.pcolormesh(words, cmap=SIGNS, vmin=-1, vmax=1, edgecolors="white", linewidth=1.5)
    ax.set(ylim=(len(words), 0), aspect="equal")
    ax.set_xticks(np.arange(words.shape[1]) + 0.5, np.arange(words.shape[1]) + 1)
    ax.tick_params(length=0, labelsize=8)
    for spine in ax.spines.values():
        spine.set_visible(False)


def legend_of_signs(figure) -> None:
    handles = [plt.Rectangle((0, 0), 1, 1, color=colour) for colour in (PLUS, MINUS)]
    figure.legend(
        handles,
        ["+: points lean away from the tip", "\N{MINUS SIGN}: points lean towards the tip"],
        ncol=2,
        fontsize=9,
        frameon=False,
        loc="outside lower center",
    )


def draw_recipients(copies: Copies, path: Path) -> None:
    """Draw what the words of two recipients ask of every ring about every tip."""
    figure, axes = plt.subplots(1, 2, figsize=(WIDTH, 3.9), layout="constrained")
    for ax, name in zip(axes, RECIPIENTS, strict=True):
        show(ax, rings(copies, copies.words(KEY, name)), f'the copy for "{name}"')
    legend_of_signs(figure)
    save(figure, path)


def rings(copies: Copies, signs: FloatArray, only: int | None = None):
    """Render the creature with the rings about its tips in the colours of signs (C, K)."""
    P, F, anchors = copies.frame.points, copies.frame.faces, copies.subject.anchors.vertices
    H, *_ = copies.subject.distances(P, F)
    width = copies.subject.scheme.parameters.width
    reach = np.where(np.isfinite(H), H, 10.0)
    if only is not None:
        reach, signs = reach[[only]], signs[[only]]
    tips = P[anchors if only is None else anchors[[only]]]
    colours = linear([MINUS, PLUS])

    def paint(v: FloatArray) -> FloatArray:
        nearest, x = v.argmin(axis=1), v.min(axis=1) / width - 1.0
        k = np.floor(x).astype(int)
        inside = (k >= 0) & (k < signs.shape[1])
        sign = np.where(inside, signs[nearest, np.clip(k, 0, signs.shape[1] - 1)], 0.0)
        # A thin gap, so that neighbours of one sign are seen to be two rings.
        gap = (x - k < 0.1) | (x - k > 0.9)
        return np.where(((sign != 0.0) & ~gap)[:, None], colours[(sign > 0).astype(int)], CLAY)

    return picture(P, F, reach.T, paint, copies.view(), tips, BALL * copies.root_area)


def draw_evidence(copies: Copies, path: Path) -> None:
    """Draw the evidence about one tip, of the marked frame and of the original."""
    words, c = copies.words(KEY), 0
    chips = measured(copies)
    figure = plt.figure(figsize=(WIDTH, 4.0), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=(1.0, 1.15))
    ax = left.subplots()
    show(ax, rings(copies, words, only=c), "rings about one tip, in the colours of the key's word")
    tip = copies.frame.points[copies.subject.anchors.vertices[[c]]]
    [[x, y]] = on_picture(tip, copies.view())
    arrow = {"arrowstyle": "->", "color": RED}
    ax.annotate("tip", (x, y), (x - 8, y + 70), color=RED, arrowprops=arrow)
    axes = right.subplots(2, 1, sharex=True, sharey=True)
    k = np.arange(1, words.shape[1] + 1)
    for ax, S, name in zip(axes, chips, ("marked copy", "original, never marked"), strict=True):
        fits = int((np.sign(S[c]) == words[c]).sum())
        ax.bar(k, S[c], 0.7, color=np.where(np.sign(S[c]) == words[c], GREEN, "0.55"))
        for x, sign in zip(k, words[c], strict=True):
            colour = PLUS if sign > 0 else MINUS
            ax.add_patch(plt.Rectangle((x - 0.42, -1.5), 0.84, 0.25, color=colour))
        ax.axhline(0.0, color=DARK, lw=0.6)
        ax.set_title(f"{name}: {fits} of {len(k)} signs as in the word", fontsize=10, loc="left")
        ax.set(ylim=(-1.55, 1.1), yticks=[-1, 0, 1])
        ax.set_yticklabels(["clearly \N{MINUS SIGN}", "unclear", "clearly +"])
        ax.tick_params(labelsize=8)
        ax.spines[["top", "right", "bottom"]].set_visible(False)
    axes[1].set_xticks(k)
    axes[1].set_xlabel("ring; squares show the word, green bars agree with it", fontsize=9)
    save(figure, path)


def measured(copies: Copies) -> tuple[FloatArray, FloatArray]:
    """Evidence (C, K) about the anchors of the marked frame and of the original, blindly.

    Both as the hypothesis of scale gives it that fits the marked frame best.
    """
    words, anchors = copies.words(KEY), copies.subject.anchors.vertices
    P = copies.frame.points
    found = [copies.subject.scheme.observe(frame) for frame in (copies.marked, copies.frame)]
    soft = []
    for one in found:
        away = np.linalg.norm(P[anchors][:, None] - P[one.vertices], axis=2)
        soft.append(np.asarray(one.soft, dtype=np.float64)[:, away.argmin(axis=1)])
    best = int((soft[0] * words).sum(axis=(1, 2)).argmax())
    return soft[0][best], soft[1][best]


def draw_e_values(copies: Copies, path: Path) -> None:
    """Draw the e-values of many random keys on the marked frame, and that of the true key."""
    [evidence] = evidence_of(copies.marked)
    variant = evidence.variants[0]
    rng = np.random.default_rng(0)
    words = [evidence.words(Key(rng.bytes(32)), None) for _ in range(N_KEYS)]
    words.append(evidence.words(KEY, None))
    log10_e = word_log_e_means(
        variant.pooled, variant.belief, np.array(words), variant.posterior
    ) / np.log(10.0)
    random, true = log10_e[:-1], float(log10_e[-1])
    print(f"log10 e: random keys {random.min():.2f} to {random.max():.2f}, true key {true:.2f}")
    figure, ax = plt.subplots(figsize=(WIDTH, 3.4), layout="constrained")
    ax.hist(random, bins=np.arange(-6.0, 6.01, 0.25), color="0.6")
    top = ax.get_ylim()[1]
    ax.axvline(LIMIT, color=RED, lw=1.5)
    ax.text(LIMIT + 0.2, 0.95 * top, "from here on: marked", color=RED, fontsize=9, va="top")
    ax.plot(true, 0.0, "o", ms=10, color=GREEN, clip_on=False, zorder=3)
    ax.text(true, 0.06 * top, f"your key\n$10^{{{true:.1f}}}$", color=GREEN, ha="center")
    ax.text(random.mean(), 1.02 * top, f"{N_KEYS:,} random keys", color="0.35", ha="center")
    ticks = np.arange(-6, 25, 3)
    ax.set_xticks(ticks, ["1" if t == 0 else f"$10^{{{t}}}$" for t in ticks])
    ax.set(xlim=(-6.5, max(25.0, true + 1.5)), ylim=(0, 1.15 * top), ylabel="number of keys")
    ax.set_xlabel("e-value: how many times better the key fits than chance")
    ax.spines[["top", "right"]].set_visible(False)
    save(figure, path)


@dataclass(frozen=True)
class Answer:
    """A verdict beside the lowest log10 p that the file could have shown."""

    name: str
    verdict: str
    log10_p: float
    reachable: float


def answer(name: str, frame: Frame) -> Answer:
    evidence = evidence_of(frame)
    verdict = decide(name, evidence, KEY)
    paid = zip(evidence, shares(evidence), strict=True)
    reachable = min((item.reachable_log10_p - share for item, share in paid), default=0.0)
    print(f"{name}: {verdict.verdict}, log10 p {verdict.log10_p:.1f}, reachable {reachable:.1f}")
    return Answer(name, verdict.verdict, verdict.log10_p, reachable)


def attacked(frame: Frame, name: str, **parameters: object) -> Frame:
    attack = make_attack(name, **parameters)
    return attack.apply(MeshAnimation.from_frames([frame]), np.random.default_rng(0))[0]


def draw_verdicts(copies: Copies, path: Path) -> None:
    """Draw p of several files, the least each could have shown, and the limit between."""
    marked = copies.marked
    nose = "1,0,0"
    answers = [
        answer("marked copy", marked),
        answer(
            "marked copy, 30 % cut off", attacked(marked, "cropping", share=0.3, direction=nose)
        ),
        answer("marked copy, all points replaced", attacked(marked, "remeshing-sdf")),
        answer("original, never marked", copies.frame),
        answer(
            "marked copy, only the tail left",
            attacked(marked, "cropping", share=0.93, direction=nose),
        ),
    ]
    colours = {"marked": GREEN, "not marked": DARK, "inconclusive": "#8a6d3b"}
    figure, ax = plt.subplots(figsize=(WIDTH, 3.4), layout="constrained")
    for row, one in enumerate(answers):
        ax.barh(row, -one.reachable, 0.5, color="0.86")
        ax.plot(-one.log10_p, row, "o", ms=9, color=colours[one.verdict], clip_on=False, zorder=3)
        ax.text(32.5, row, one.verdict, color=colours[one.verdict], va="center", weight="bold")
    ax.axvline(LIMIT, color=RED, lw=1.5)
    ax.text(LIMIT, -0.75, "from here on: marked", color=RED, fontsize=9, ha="center")
    handles = [
        plt.Line2D([], [], marker="o", ms=9, color=DARK, lw=0),
        plt.Rectangle((0, 0), 1, 1, color="0.86"),
    ]
    labels = ["what your key shows", "what the best of keys could show"]
    figure.legend(handles, labels, ncol=2, fontsize=9, frameon=False, loc="outside lower center")
    ax.set_yticks(range(len(answers)), [one.name for one in answers])
    ticks = np.arange(0, 31, 6)
    ax.set_xticks(ticks, ["1" if t == 0 else f"$10^{{-{t}}}$" for t in ticks])
    ax.set(xlim=(0, 32), ylim=(len(answers) - 0.5, -0.6))
    ax.set_xlabel("p: chance that a random key does as well; smaller to the right")
    ax.spines[["top", "right"]].set_visible(False)
    save(figure, path)


DRAWINGS = {
    "mark": draw_mark,
    "key": draw_key,
    "recipient": draw_recipients,
    "evidence": draw_evidence,
    "e-value": draw_e_values,
    "verdict": draw_verdicts,
}


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=REPOSITORY / "docs" / "concepts")
    options = parser.parse_args(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    copies = Copies.of(subject_of(None, azimuth=30.0))
    for name, draw in DRAWINGS.items():
        draw(copies, options.output / f"{name}.png")


if __name__ == "__main__":
    main()
