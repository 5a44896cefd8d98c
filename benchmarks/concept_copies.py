"""What the pictures of docs/concepts.md show: the demonstration's creature, before and after."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from apex_figures import Subject, framed
from meshmark import Key
from meshmark.arrays import IntArray
from meshmark.mesh.animation import Frame
from render import View

WIDTH = 10.4  # inches
RED = "#c0392b"


@dataclass(frozen=True, eq=False)
class Copies:
    """The first frame of the creature, unmarked and marked, and what blind detection measures."""

    subject: Subject
    frame: Frame
    marked: Frame

    @classmethod
    def of(cls, subject: Subject) -> Copies:
        frame = subject.animation[0]
        return cls(subject, frame, Frame(frame.time, subject.marked[0], frame.topology))

    def words(self, key: Key, recipient: str | None = None) -> IntArray:
        """Words of the anchors that are marked, (C, K)."""
        scheme = self.subject.scheme
        words = key.words("apex", scheme.n_words, scheme.n_chips, recipient)
        return words[self.subject.anchors.words]

    def view(self) -> View:
        return framed(self.subject, self.frame.points)

    @property
    def root_area(self) -> float:
        """Square root of the area of the surface."""
        P, F = self.frame.points, self.frame.faces
        normals = np.cross(P[F[:, 1]] - P[F[:, 0]], P[F[:, 2]] - P[F[:, 0]])
        return float(np.sqrt(np.linalg.norm(normals, axis=1).sum() / 2.0))
