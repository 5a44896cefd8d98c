"""What became of single faces and vertices of one frame."""

from __future__ import annotations

import math

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import area_vectors, face_areas, lengths
from meshmark.mesh.topology import edges

# A face whose normal is shorter than this share of its longest edge squared has no direction.
_SLIVER = 1e-12


def flipped_faces(V0: FloatArray, V1: FloatArray, F: IntArray) -> int:
    """Count the faces whose normal turned by more than 90 degrees.

    A face without area before or after has no normal and is not counted.

    Parameters
    ----------
    V0, V1 : (N, 3) float64
        Vertex positions before and after.
    F : (F, 3) int
        Triangles.
    """
    n0, n1 = _normals(V0, F), _normals(V1, F)
    return int(np.count_nonzero(_dot(n0, n1) < 0))


def min_angle_change(V0: FloatArray, V1: FloatArray, F: IntArray) -> float:
    """Measure by how much the smallest angle of a face shrank, in degrees, at worst.

    Each face is compared with itself: the smallest angle of the whole mesh would only tell of
    the slivers it came with. A face without area before has an angle of 0 to lose.

    Parameters
    ----------
    V0, V1 : (N, 3) float64
        Vertex positions before and after.
    F : (F, 3) int
        Triangles.

    Returns
    -------
    float
        Largest loss over all faces, from 0 if none lost to 60.
    """
    loss = smallest_angles(V0, F) - smallest_angles(V1, F)
    return float(loss.max(initial=0.0))


def smallest_angles(V: FloatArray, F: IntArray) -> FloatArray:
    """Compute the smallest angle of each face in degrees, (F,); 0 for one without area."""
    a, b, c = (V[i] for i in F.T)
    # |u| |v| sin is twice the area at each corner: the smallest angle is where |u| |v| cos is most.
    cosine = np.max([_dot(b - a, c - a), _dot(c - b, a - b), _dot(a - c, b - c)], axis=0)
    # The arctangent is exact for needles, where a cosine near 1 has no digits left.
    return np.degrees(np.arctan2(2.0 * face_areas(V, F), cosine))


def normal_turn(V0: FloatArray, V1: FloatArray, F: IntArray) -> float:
    """Measure by how much normals turned: root mean square over the area before, in degrees.

    A face without area before or after has no normal and is not counted.

    Parameters
    ----------
    V0, V1 : (N, 3) float64
        Vertex positions before and after.
    F : (F, 3) int
        Triangles.
    """
    n0, n1 = _normals(V0, F), _normals(V1, F)
    area = lengths(n0) * (lengths(n1) > 0.0)
    if not area.any():
        return 0.0
    # The arctangent is exact for small angles, where a cosine near 1 has no digits left.
    angle = np.degrees(np.arctan2(lengths(np.cross(n0, n1)), _dot(n0, n1)))
    return float(np.sqrt((area * angle**2).sum() / area.sum()))


def max_move_edges(V0: FloatArray, V1: FloatArray, F: IntArray) -> float:
    """Measure the largest move of a vertex in mean edge lengths of the mesh before.

    Parameters
    ----------
    V0, V1 : (N, 3) float64
        Vertex positions before and after.
    F : (F, 3) int
        Triangles.
    """
    E = edges(F)
    length = float(np.linalg.norm(V0[E[:, 0]] - V0[E[:, 1]], axis=1).mean()) if len(E) else 0.0
    move = float(np.linalg.norm(V1 - V0, axis=1).max(initial=0.0))
    if move == 0.0:
        return 0.0
    return move / length if length > 0 else math.inf


def _normals(V: FloatArray, F: IntArray) -> FloatArray:
    """Compute face normals of any length, zero where there is no direction, (F, 3)."""
    a, b, c = (V[i] for i in F.T)
    n = 2.0 * area_vectors(V, F)
    longest = np.max([_dot(side, side) for side in (b - a, c - b, a - c)], axis=0)
    n[lengths(n) <= _SLIVER * longest] = 0.0
    return n


def _dot(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.einsum("ij,ij->i", x, y)
