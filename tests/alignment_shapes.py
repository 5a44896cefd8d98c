"""A shape without symmetries that moves, copies of it, and how well they were placed."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from meshmark.alignment.placement import MeshAlignment
from meshmark.arrays import FloatArray
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.geometry import surface_box
from meshmark.testing.meshes import bumpy_sphere

HORNS = np.array([[1.0, 0.2, 0.1], [-0.3, 1.0, 0.4], [0.2, -0.8, 1.0], [-0.7, -0.3, -0.9]])


def nodding(level: int = 3, frames: int = 5) -> MeshAnimation:
    """Animate a shape without symmetries: one of its horns grows, another shrinks."""
    share = np.linspace(0.0, 1.0, frames)
    stack = [
        bumpy_sphere(level, HORNS, np.array([1.0 + t, 0.5, 1.5 - t, 0.8]), 0.35)[0] for t in share
    ]
    return MeshAnimation.from_arrays(np.stack(stack), bumpy_sphere(level, HORNS)[1], prim="/body")


def similarity(seed: int, mirror: bool = False) -> FloatArray:
    """Draw a similarity [s R | t] that takes originals to copies, (3, 4)."""
    rng = np.random.default_rng(seed)
    R = Rotation.random(random_state=seed).as_matrix()
    R = R * (np.array([-1.0, 1.0, 1.0]) if mirror else 1.0)
    return np.column_stack([np.exp(rng.uniform(-2, 2)) * R, rng.uniform(-9, 9, 3)])


def mapped(A: FloatArray, P: FloatArray) -> FloatArray:
    return P @ A[:, :3].T + A[:, 3]


def placed(original: MeshAnimation, A: FloatArray) -> MeshAnimation:
    return original.map(lambda frame: frame.moved(mapped(A, frame.points)))


def errors(found: MeshAlignment, A: FloatArray) -> FloatArray:
    """Measure by how much the maps miss the inverse of A, in diagonals of the original."""
    first = found.original[0]
    diagonal, _ = surface_box(first.points, first.faces)
    back = [frame.maps["similarity"](mapped(A, first.points)) for frame in found.frames]
    return (
        np.array([np.sqrt(((P - first.points) ** 2).sum(axis=1).mean()) for P in back]) / diagonal
    )


def shuffled(original: MeshAnimation, seed: int = 0) -> MeshAnimation:
    """Put vertices and faces into another order."""
    rng = np.random.default_rng(seed)
    F, n = original[0].faces, len(original[0].points)
    order = rng.permutation(n)
    rank = np.argsort(order)
    stack = np.stack([frame.points[order] for frame in original])
    return MeshAnimation.from_arrays(stack, rank[F][rng.permutation(len(F))])
