"""Morph targets of vertices that slid: what they are at the new places."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass, replace

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.charts import SlidPoints, equal_rows
from meshmark_plugins.readers.gltf.geometry import Geometry, Vertices

# Displacements this near to each other, as a share of the largest, differ by rounding.
SAME = 1e-7


@dataclass(frozen=True, eq=False)
class Followed:
    """A mesh of a document whose morph targets have followed its vertices.

    Parameters
    ----------
    geometry : Geometry
        With other targets.
    changes : mapping of int to (n, 3) float64
        How much those in accessors have changed.
    """

    geometry: Geometry
    changes: Mapping[int, FloatArray]


def followed(
    geometry: Geometry, moves: Mapping[int, FloatArray], replaceable: Container[int]
) -> Followed:
    """Give vertices that slid the displacements of their new places on the surface at rest.

    These are interpolated in the triangle there. Vertices that coincide and move alike stay
    together.

    Parameters
    ----------
    geometry : Geometry
    moves : mapping of int to (n, 3) float64
        How far the positions of accessors move.
    replaceable : container of int
        Accessors of targets that can follow; the others stay.
    """
    vertices = geometry.vertices
    V = vertices.points.astype(np.float64)
    move = np.concatenate([moves[accessor] for accessor, _ in geometry.positions])
    slid = SlidPoints.of(geometry.topology.triangles, V, V + move, _alike(vertices))
    begins = [begin for _, begin in geometry.positions]
    parts = list(zip(geometry.targets, begins, [*begins[1:], len(V)], strict=True))
    targets: list[FloatArray] = []
    changes: dict[int, FloatArray] = {}
    for number, target in enumerate(vertices.targets):
        old = target.astype(np.float64)
        there = slid.values(old)
        changed = np.any(np.abs(there - old) > SAME * np.abs(old).max(initial=0.0), axis=1)
        change = np.where(changed[:, None], there - old, 0.0)
        new = old.copy()
        for accessors, begin, end in parts:
            accessor = accessors[number]
            # What two parts have in common would have to follow both.
            once = sum(accessor in other for other in geometry.targets) == 1
            if accessor is not None and accessor in replaceable and once:
                new[begin:end] += change[begin:end]
                changes[accessor] = change[begin:end]
        targets.append(new)
    other = replace(vertices, targets=tuple(targets))
    return Followed(replace(geometry, vertices=other), changes)


def _alike(vertices: Vertices) -> IntArray:
    """Return numbers (N,) that are equal for vertices that coincide, and always will."""
    number = equal_rows(np.column_stack([vertices.points, vertices.joints, vertices.weights]))
    for target in vertices.targets:
        number = equal_rows(np.column_stack([number, equal_rows(target)]))
    return number
