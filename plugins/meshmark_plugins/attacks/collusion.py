"""Differently marked copies made into one."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import UsageError
from meshmark.mesh.animation import Frame, FrameSource, MeshAnimation
from meshmark.mesh.topology import weld
from meshmark.sources.reading import read
from meshmark_plugins.attacks.frames import draw_seed
from meshmark_plugins.attacks.normals import welded_normals
from meshmark_plugins.attacks.parameters import choice

Copy = MeshAnimation | str | Path


@dataclass(frozen=True)
class Collusion:
    """Blend the animation with other copies of it.

    Parameters
    ----------
    other : MeshAnimation, str, Path, or a sequence of these
        The other copy, or copies: as many frames and vertices. Text may name several files, with
        commas or semicolons between them. From a file, the mesh at the same prim is taken, or the
        only one there is.
    kind : str
        "mean" and "median" of every coordinate over the copies; "min" and "max", at each vertex
        the copy that is lowest or highest along the normal of the mean of all; "extremes", at
        each vertex at random one of these two; "choice", each vertex from a random copy;
        "alternate", frames from each copy in turn. What is drawn at random holds for all frames.

    Raises
    ------
    UsageError
        If `kind` is out of range, or, when it is applied, no other copy is given or one is not
        alike.
    """

    other: Copy | Sequence[Copy] | None = None
    kind: str = "mean"

    def __post_init__(self) -> None:
        choice("collusion", "kind", self.kind, (*BLENDS, "alternate"))

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return what the copies make together."""
        others = self._others(animation.prim)
        for number, other in enumerate(others, start=1):
            if len(other) != len(animation):
                which = "the other copy" if len(others) == 1 else f"other copy {number}"
                raise UsageError(
                    f"attack collusion: {which} has {len(other)} frames, not {len(animation)}",
                    source=animation.origin or None,
                    prim=animation.prim,
                )
        sources = (animation.source, *(other.source for other in others))
        if self.kind == "alternate":
            blended: FrameSource = AlternatingFrames(sources)
        else:
            blended = BlendedFrames(sources, self.kind, draw_seed(rng))
        shape = animation[0].topology
        constant = animation.constant_topology and all(
            shape.same_as(other[0].topology) for other in others
        )
        return replace(animation, source=blended, constant_topology=constant)

    def _others(self, prim: str) -> list[MeshAnimation]:
        given = self.other
        if isinstance(given, str):
            given = [path.strip() for path in re.split("[,;]", given) if path.strip()]
        elif isinstance(given, MeshAnimation | Path):
            given = [given]
        if not given:
            raise UsageError("attack collusion: other, a second copy, must be given")
        return [_loaded(copy, prim) for copy in given]


def _loaded(copy: Copy, prim: str) -> MeshAnimation:
    if isinstance(copy, MeshAnimation):
        return copy
    asset = read(copy)
    return asset.meshes[0] if len(asset.meshes) == 1 else asset.mesh(prim)


@dataclass(frozen=True)
class AlternatingFrames:
    """Frames of several sources in turn."""

    sources: tuple[FrameSource, ...]

    def frame(self, index: int) -> Frame:
        """Read frame `index` from the source whose turn it is."""
        frame = self.sources[0].frame(index)
        turn = index % len(self.sources)
        return frame if turn == 0 else replace(self.sources[turn].frame(index), time=frame.time)


@dataclass(frozen=True)
class BlendedFrames:
    """Points of several sources made into one frame, by one of `BLENDS`."""

    sources: tuple[FrameSource, ...]
    kind: str
    seed: int

    def frame(self, index: int) -> Frame:
        """Read frame `index` of all and blend them."""
        first, *others = (source.frame(index) for source in self.sources)
        if not all(first.topology.same_as(other.topology) for other in others):
            raise UsageError("attack collusion: the copies have different faces", time=first.time)
        P = np.stack([first.points, *(other.points for other in others)])
        return first.moved(BLENDS[self.kind](P, first.faces, np.random.default_rng(self.seed)))


def _mean(P: FloatArray, F: IntArray, rng: np.random.Generator) -> FloatArray:
    mean: FloatArray = P.mean(axis=0)
    return mean


def _median(P: FloatArray, F: IntArray, rng: np.random.Generator) -> FloatArray:
    return np.median(P, axis=0)


def _lowest(P: FloatArray, F: IntArray, rng: np.random.Generator) -> FloatArray:
    return _taken(P, _heights(P, F).argmin(axis=0))


def _highest(P: FloatArray, F: IntArray, rng: np.random.Generator) -> FloatArray:
    return _taken(P, _heights(P, F).argmax(axis=0))


def _extreme(P: FloatArray, F: IntArray, rng: np.random.Generator) -> FloatArray:
    h = _heights(P, F)
    up = _drawn(P, F, 2, rng) == 1
    return _taken(P, np.where(up, h.argmax(axis=0), h.argmin(axis=0)))


def _chosen(P: FloatArray, F: IntArray, rng: np.random.Generator) -> FloatArray:
    return _taken(P, _drawn(P, F, len(P), rng))


# (k, N, 3) points of k copies, (F, 3) faces -> (N, 3) points.
BLENDS: Mapping[str, Callable[[FloatArray, IntArray, np.random.Generator], FloatArray]] = {
    "mean": _mean,
    "median": _median,
    "min": _lowest,
    "max": _highest,
    "extremes": _extreme,
    "choice": _chosen,
}


def _heights(P: FloatArray, F: IntArray) -> FloatArray:
    """Measure how far each copy lies above the mean of all, along its normals, (k, N)."""
    mean = P.mean(axis=0)
    return np.einsum("kij,ij->ki", P - mean, welded_normals(mean, F))


def _drawn(P: FloatArray, F: IntArray, n: int, rng: np.random.Generator) -> IntArray:
    """Draw one of n numbers for each vertex, (N,), the same for all that coincide."""
    _, _, new = weld(P[0], F)
    first = np.unique(new, return_index=True)[1]
    return rng.integers(n, size=(P.shape[1],))[first[new]]


def _taken(P: FloatArray, copy: IntArray) -> FloatArray:
    """Take each vertex from the copy of that number, (N, 3)."""
    return P[copy, np.arange(P.shape[1])]
