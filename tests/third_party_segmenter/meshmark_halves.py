"""Cuts a mesh in two across its longest axis."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from meshmark.errors import UsageError
from meshmark.extension.hookspecs import SegmenterRecord, hookimpl
from meshmark.mesh.topology import face_components


@dataclass(frozen=True)
class Halves:
    """Two halves, `cut` standard deviations away from the middle of the surface."""

    cut: float = 0.0

    def __post_init__(self) -> None:
        if not -1.0 <= self.cut <= 1.0:
            raise UsageError(f"cut must lie within -1 .. 1, not {self.cut:g}")

    def segment(self, V, F):
        """Label each face: points (N, 3) and triangles (F, 3) in, (F,) int out."""
        a, b, c = V[F[:, 0]], V[F[:, 1]], V[F[:, 2]]
        area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        middle = (a + b + c) / 3.0
        x = middle - np.average(middle, axis=0, weights=area)
        variance, axes = np.linalg.eigh((x.T * area) @ x / area.sum())
        t = x @ axes[:, -1] / np.sqrt(max(variance[-1], np.finfo(np.float64).tiny))
        # An eigenvector has no sign of its own; the longer tail decides.
        t = t if np.sum(area * t**3) >= 0 else -t
        # Every part must hang together, and its number may not depend on the order of faces.
        part = face_components(F, (t > self.cut).astype(np.int64))
        rank = np.argsort(np.argsort(-np.bincount(part, weights=area), kind="stable"))
        return rank[part]


def make(**parameters: Any) -> Halves:
    """Build the segmenter; what it does not take is the user's mistake."""
    unknown = parameters.keys() - {"cut"}
    if unknown:
        raise UsageError(f"halves takes cut, not {', '.join(sorted(unknown))}")
    return Halves(**parameters)


@hookimpl
def meshmark_segmenters():
    """Offer the segmenter to meshmark."""
    yield SegmenterRecord(
        name="halves",
        factory=make,
        summary="two halves across the longest axis",
        version="1.0",
        parameters={"cut": 0.0},
    )
