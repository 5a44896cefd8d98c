"""The same mesh in other coordinates or another order, for tests that nothing else changes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Reordered:
    """A mesh whose vertices, faces and corners stand in another order.

    Parameters
    ----------
    V : (N, 3) float64
    F : (F, 3) int64
        The re-ordered mesh, oriented as before.
    vertex : (N,) int64
        Old index of each vertex.
    face : (F,) int64
        Old index of each face.
    """

    V: FloatArray
    F: IntArray
    vertex: IntArray
    face: IntArray


def reordered(V: FloatArray, F: IntArray, rng: np.random.Generator) -> Reordered:
    """Shuffle vertices and faces, and turn the corners of each face."""
    vertex, face = rng.permutation(len(V)), rng.permutation(len(F))
    new = np.empty(len(V), dtype=np.int64)
    new[vertex] = np.arange(len(V))
    turn = (np.arange(3) + rng.integers(0, 3, size=(len(F), 1))) % 3
    corners = np.take_along_axis(new[F[face]], turn, axis=1)
    return Reordered(V[vertex], corners, vertex, face)


def moved(V: FloatArray, scale: float, rng: np.random.Generator) -> FloatArray:
    """Turn points about a random axis, scale them, and shift them by some of their extent."""
    Q, R = np.linalg.qr(rng.normal(size=(3, 3)))
    rotation = Q * np.sign(np.diag(R))
    rotation[:, 0] *= np.linalg.det(rotation)
    shift = rng.uniform(-5.0, 5.0, size=3) * np.ptp(V, axis=0).max()
    return scale * (V @ rotation.T + shift)
