"""Fewer points of a mesh, that show its shape: what a page can hold, in every frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import InputError
from meshmark.extension.recipe import Recipe
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.checks import require_extent, require_measurable
from meshmark.mesh.geometry import surface_box
from meshmark.mesh.runs import cut, longest, runs
from meshmark.mesh.welding import Welding
from meshmark.reporting.places import anchors_of, parts_of

# Frames of a mesh among which one that can be read is looked for.
TRIES = 12
# Rounds in which a simplification that left too many points is asked for fewer.
ROUNDS = 4


@dataclass(frozen=True, eq=False)
class ShownMesh:
    """Some points of a mesh, and triangles between them, that stand for all of it.

    Parameters
    ----------
    mesh : MeshAnimation
        Of constant topology: the longest run of frames where it changes.
    points : (n,) int
        Which points of the mesh; the same in every frame.
    faces : (f, 3) int
        Triangles between them.
    parts : (n,) int
        Part of the mesh that each lies in.
    anchors : (a,) int
        Those at which carriers stand.
    n_runs, n_frames : int
        Of the mesh in all.
    """

    mesh: MeshAnimation
    points: IntArray
    faces: IntArray
    parts: IntArray
    anchors: IntArray
    n_runs: int
    n_frames: int


def shown_mesh(animation: MeshAnimation, most: int, recipes: Sequence[Recipe] = ()) -> ShownMesh:
    """Choose at most so many points of a mesh, by simplifying one frame, and its anchors.

    Raises
    ------
    InputError, CapacityError
        If no frame of it can be shown.
    """
    every = runs(animation)
    if not every:
        raise InputError("no frame can be read", source=animation.origin, prim=animation.prim)
    mesh = cut(animation, longest(every, 1)[0])
    frame = _readable(mesh)
    welding = Welding.of(frame)
    analysed = welding.frame(frame)
    V, F = analysed.points, analysed.faces
    parts = np.zeros(len(V), dtype=np.int64)
    parts[F.ravel()] = np.repeat(parts_of(analysed, recipes), 3)
    kept, faces = simplified(V, F, most)
    anchors = anchors_of(analysed, recipes)
    vertices = np.concatenate([kept, anchors])
    places = len(kept) + np.arange(len(anchors))
    return ShownMesh(
        mesh,
        welding.kept[vertices],
        faces,
        parts[vertices],
        places,
        n_runs=len(every),
        n_frames=len(animation),
    )


def simplified(V: FloatArray, F: IntArray, most: int) -> tuple[IntArray, IntArray]:
    """Choose at most so many vertices of a surface that keep its shape.

    Parameters
    ----------
    V : (N, 3) float64
    F : (F, 3) int
    most : int

    Returns
    -------
    vertices : (n,) int
        Increasing.
    faces : (f, 3) int
        Triangles between them.

    References
    ----------
    M. Garland, P. S. Heckbert, "Surface simplification using quadric error metrics", SIGGRAPH
    1997. doi:10.1145/258734.258849
    """
    if len(V) <= most:
        return np.arange(len(V)), F
    import fast_simplification

    diagonal, centre = surface_box(V, F)
    local = (V - centre) / diagonal
    # A closed surface has twice as many triangles as vertices; what has borders, fewer.
    target = 2 * most
    for _ in range(ROUNDS):
        points, faces = fast_simplification.simplify(
            local, F.astype(np.int32), target_count=min(target, len(F))
        )
        # The points of the file itself are shown, those nearest to where they would be best.
        _, nearest = cKDTree(local).query(points)
        kept, corners = np.unique(nearest[faces], return_inverse=True)
        if len(kept) <= most:
            break
        target = max(int(0.9 * target * most / len(kept)), 4)
    faces = corners.reshape(-1, 3).astype(np.int64)
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    return _at_most(kept, faces, most)


def _at_most(kept: IntArray, faces: IntArray, most: int) -> tuple[IntArray, IntArray]:
    """Drop the triangles of vertices that are too many: of soup that cannot be simplified."""
    faces = faces[np.all(faces < most, axis=1)]
    used, corners = np.unique(faces, return_inverse=True)
    return kept[used], corners.reshape(-1, 3)


def _readable(mesh: MeshAnimation) -> Frame:
    for index in np.linspace(0, len(mesh) - 1, min(TRIES, len(mesh))).round().astype(int):
        try:
            frame = mesh[int(index)]
            require_measurable(frame.points)
            require_extent(frame.points, frame.faces)
        except InputError as error:
            reason = error
        else:
            return frame
    raise reason
