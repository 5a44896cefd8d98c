"""Parts of a mesh as the scheme uses them: a sub-mesh and its shortest cut."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import BoolArray, IntArray
from meshmark.mesh.topology import edges, face_adjacency, graph_components

# Moving vertices beside a cut moves the cut, and with it every distance of the part. With two
# rings held still, the marked frame is cut where the original was: measured on two animals in
# five poses, blind detection then finds what was embedded, where before it lost half of it.
FIXED_RINGS = 2
# Distances from every vertex of a part's cut to all of its vertices that are still computed: a
# cut of a hundred vertices or two is usual, one of thousands is made to take for ever.
MAX_DISTANCES = 50_000_000


@dataclass(frozen=True, eq=False)
class Part:
    """One part, as vertex trajectories carry it through the frames.

    Parameters
    ----------
    vertices : (n,) int
        Vertices of the frame the part's faces use.
    faces : (f, 3) int
        The part's triangles, indices into `vertices`.
    edges : (e, 2) int
        The part's edges, indices into `vertices`.
    loop : (L,) int
        The cutting boundary distances are measured from, indices into `vertices`.
    inside : (n,) bool
        Which vertices lie on no cut; those are sorted into sets.
    fixed : (n,) bool
        Which vertices must not move: those on any cut, and the rings next to it.
    """

    vertices: IntArray
    faces: IntArray
    edges: IntArray
    loop: IntArray
    inside: BoolArray
    fixed: BoolArray


def labelled_parts(F: IntArray, labels: IntArray, min_vertices: int) -> tuple[Part, ...]:
    """Split a labelled mesh into the parts that can carry a mark.

    Parameters
    ----------
    F : (F, 3) int
        Triangles.
    labels : (F,) int
        Part of each triangle.
    min_vertices : int
        Parts with fewer vertices inside are left out, as are parts without a cut, and those whose
        cut has so many vertices that more than `MAX_DISTANCES` would have to be computed.

    Returns
    -------
    tuple of Part
        In order of their labels.
    """
    pairs, shared = face_adjacency(F)
    crossing = labels[pairs[:, 0]] != labels[pairs[:, 1]]
    pairs, shared = pairs[crossing], shared[crossing]
    parts = []
    for label in np.unique(labels):
        touching = np.any(labels[pairs] == label, axis=1)
        if not touching.any():
            continue
        part = _part(F[labels == label], shared[touching])
        distances = len(part.loop) * len(part.vertices)
        if np.count_nonzero(part.inside) >= min_vertices and distances <= MAX_DISTANCES:
            parts.append(part)
    return tuple(parts)


def _part(F: IntArray, cut: IntArray) -> Part:
    vertices, local = np.unique(F, return_inverse=True)
    faces = local.reshape(-1, 3)
    cut = np.searchsorted(vertices, cut)
    on_cut = np.zeros(len(vertices), dtype=bool)
    on_cut[cut] = True
    own_edges = edges(faces)
    return Part(
        vertices=vertices,
        faces=faces,
        edges=own_edges,
        loop=smallest_loop(cut),
        inside=~on_cut,
        fixed=dilated(on_cut, own_edges, FIXED_RINGS),
    )


def dilated(chosen: BoolArray, E: IntArray, rings: int) -> BoolArray:
    """Add to some vertices those within `rings` edges of them, (n,) bool."""
    wide = chosen.copy()
    for _ in range(rings):
        wide[E[wide[E].any(axis=1)]] = True
    return wide


def smallest_loop(cut: IntArray) -> IntArray:
    """Return the vertices of the connected cut with the fewest of them.

    Parameters
    ----------
    cut : (E, 2) int
        Edges of all the cuts of a part.

    Returns
    -------
    (L,) int
        Sorted vertex indices; of several equally small cuts, the one with the lowest index.
    """
    used, local = np.unique(cut, return_inverse=True)
    label = graph_components(local.reshape(-1, 2), len(used))
    return used[label == np.bincount(label).argmin()].astype(np.int64)
