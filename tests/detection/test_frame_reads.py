"""How often frames are read, which can take longer than measuring them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from meshmark.detection.reference_frame import SAMPLED_FRAMES
from meshmark.detection.verify import verify
from meshmark.errors import CapacityError
from meshmark.extension.carrier import Observation
from meshmark.keys import Key
from meshmark.mesh.animation import Frame, FrameSource, MeshAnimation
from meshmark.testing.meshes import icosphere

KEY = Key(bytes(range(32)))
NAME, M, K = "oracle", 4, 16
WORDS = KEY.words(NAME, M, K)
FRAMES = 40


@dataclass(frozen=True)
class CountingFrames:
    """Frames of another source, and how often each was read."""

    base: FrameSource
    reads: Counter[int] = field(default_factory=Counter)

    def frame(self, index: int) -> Frame:
        self.reads[index] += 1
        return self.base.frame(index)


@dataclass
class MarkedAt:
    """A scheme that sees the words of the key at some times, and noise at the others."""

    times: set[float]
    follows_vertices: bool
    restorations: tuple[int, ...] = (0,)
    n_chips = K
    n_words = M

    def observe(self, frame, reference=None) -> Observation:
        if reference is None:
            raise CapacityError("all frames share a topology, and have a reference")
        noise = np.random.default_rng(int(frame.time)).uniform(-1, 1, size=(M, K))
        soft = WORDS if frame.time in self.times else noise
        return Observation(soft[None], np.zeros(1), np.zeros((M, 1)), np.arange(M))


@dataclass
class MadeAlready:
    """Stands where a `Recipe` would."""

    made: MarkedAt
    scheme: str = NAME
    informed: bool = False

    def build(self) -> MarkedAt:
        return self.made


def swinging() -> tuple[MeshAnimation, Counter[int]]:
    """Turn a ball about a point, so that no frame is a blend; and count how often it is read."""
    V, F = icosphere(1)
    angle = 0.2 * np.arange(FRAMES)
    turned = np.stack([np.cos(angle), np.sin(angle), np.zeros(FRAMES)], axis=1)
    moved = V + 5.0 * turned[:, None]
    animation = MeshAnimation.from_arrays(moved, F, times=np.arange(float(FRAMES)))
    source = CountingFrames(animation.source)
    return replace(animation, source=source), source.reads


@pytest.mark.parametrize("follows", [True, False])
def test_a_mark_in_the_first_frame_takes_the_sampled_frames_and_hardly_a_read_more(follows) -> None:
    animation, reads = swinging()
    recipes = [MadeAlready(MarkedAt({0.0}, follows))]
    assert verify(animation, KEY, recipes=recipes, frames="auto").verdict == "marked"
    # Sampled to choose the reference, shown to the search for surfaces, and looked at.
    assert reads[0] == 3
    assert len(reads) == SAMPLED_FRAMES
    assert reads.total() == SAMPLED_FRAMES + 2


def test_schemes_share_what_was_sampled() -> None:
    animation, reads = swinging()
    recipes = [MadeAlready(MarkedAt(set(), True), name) for name in ("a", "b", "c")]
    assert verify(animation, KEY, recipes=recipes, frames=":").verdict == "not marked"
    assert reads.total() == SAMPLED_FRAMES + 1 + 3 * FRAMES


def test_blends_are_told_apart_by_reading_each_frame_once_more() -> None:
    animation, reads = swinging()
    recipes = [MadeAlready(MarkedAt(set(), False))]
    verify(animation, KEY, recipes=recipes, frames=":")
    # The reference is looked at with the others, and once more to match carriers by place.
    assert reads.total() <= SAMPLED_FRAMES + 1 + 2 * FRAMES


def test_frames_outside_the_range_are_not_measured() -> None:
    animation, reads = swinging()
    recipes = [MadeAlready(MarkedAt({10.0}, True))]
    assert verify(animation, KEY, recipes=recipes, frames="10:12").verdict == "marked"
    sampled = np.linspace(0, FRAMES - 1, SAMPLED_FRAMES).round()
    assert set(reads) == {10, 11, 12, *map(int, sampled)}
