"""Marking a copy again, with keys of one's own."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from meshmark.embedding.asset import embed
from meshmark.errors import CapacityError
from meshmark.keys import KEY_BYTES, Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.workers.scratch import DisplacedFrames, ScratchFile
from meshmark_plugins.attacks.frames import require_trajectories
from meshmark_plugins.attacks.parameters import whole


@dataclass(frozen=True)
class MarkingAgain:
    """Mark a copy with all default layers and random keys, as whoever has this program can.

    Parameters
    ----------
    copies : int
        With more than 1, so many copies are marked, with different keys, and the result is
        their mean. In [1, 100].

    Raises
    ------
    UsageError
        If the parameter is out of range, or the connectivity changes from frame to frame.

    Notes
    -----
    Schemes plan all frames together: `apply` reads and marks all of them, `copies` times, at
    the cost of `meshmark embed` with one process. Displacements are kept in a temporary file,
    which lives as long as the result. A mesh that can hold no mark stays as it is, which is noted.
    """

    copies: int = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "copies", whole("marking-again", "copies", self.copies, 1, 100))

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the animation marked again."""
        require_trajectories("marking-again", animation, "a mean of copies")
        mean = ScratchFile.create(len(animation), animation[0].topology.n_points)
        for _ in range(self.copies):
            key = Key(rng.bytes(KEY_BYTES))
            try:
                [copy] = embed(animation, key).asset.meshes
            except CapacityError as error:
                note = f"attack marking-again left it as it is: {error.message}"
                return replace(animation, notes=(*animation.notes, note))
            for index, (before, after) in enumerate(zip(animation, copy, strict=True)):
                move = (after.points - before.points) / self.copies
                mean.write(index, mean.read(index) + move)
        return replace(animation, source=DisplacedFrames(animation.source, mean))
