"""From labels to parts: connected, none too small, in an order that no index decides."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.topology import face_components, graph_components
from meshmark_plugins.segmenters.sdf.dual import DualGraph


def parts_of(labels: IntArray, F: IntArray, dual: DualGraph, min_area: float) -> IntArray:
    """Turn labels into parts: connected regions of equal label, the small ones merged.

    Parameters
    ----------
    labels : (F,) int
        Label of each face.
    F : (F, 3) int
        Triangles.
    dual : DualGraph
        Their areas and shared edges.
    min_area : float
        Share of the area below which a region takes a neighbour's label. A small component of
        the mesh has no neighbour and stays a part of its own.

    Returns
    -------
    (F,) int64
        Parts by decreasing area; among equals the one nearest to the mesh's centroid first.
    """
    region = face_components(F, labels)
    merged = _merge_small(region, labels, dual, min_area)
    return _by_area(merged[region], dual)


def _merge_small(region: IntArray, labels: IntArray, dual: DualGraph, min_area: float) -> IntArray:
    """Find the final part of each region, (regions,) int.

    In each round a small region with no smaller neighbour takes the label it shares the
    longest border with, and so joins at least one neighbour: the rounds come to an end.
    """
    n = int(region.max()) + 1
    area = _sums(region, dual.area, n)
    label = np.zeros(n, dtype=np.int64)
    label[region] = labels
    i, j = region[dual.pairs].T
    outer = i != j
    i, j = np.r_[i[outer], j[outer]], np.r_[j[outer], i[outer]]
    # An edge without length still makes neighbours.
    border = np.tile(dual.length[outer] + 1e-12, 2)
    part: IntArray = np.arange(n)
    while True:
        m = int(part.max()) + 1
        part_area = _sums(part, area, m)
        part_label = np.zeros(m, dtype=np.int64)
        part_label[part] = label
        a, b = part[i], part[j]
        outer = a != b
        joining = _joining(part_area, a[outer], b[outer], min_area)
        if not joining.any():
            return part
        shared = np.zeros((m, int(label.max()) + 1))
        np.add.at(shared, (a[outer], part_label[b[outer]]), border[outer])
        part_label[joining] = shared[joining].argmax(axis=1)
        label = part_label[part]
        equal = label[i] == label[j]
        part = graph_components(np.stack([i[equal], j[equal]], axis=1), n)


def _joining(area: FloatArray, a: IntArray, b: IntArray, min_area: float) -> NDArray[np.bool_]:
    """Tell which parts are too small and the smallest among their neighbours, (parts,) bool.

    `a` and `b` list neighbours, each pair both ways.
    """
    n = len(area)
    rank = np.empty(n, dtype=np.int64)
    rank[np.argsort(area, kind="stable")] = np.arange(n)
    smallest = np.full(n, n)
    np.minimum.at(smallest, a, rank[b])
    with_neighbours = smallest < n
    return (area < min_area) & with_neighbours & (rank < smallest)


def _by_area(part: IntArray, dual: DualGraph) -> IntArray:
    n = int(part.max()) + 1
    area = _sums(part, dual.area, n)
    moment = np.stack([_sums(part, dual.area * x, n) for x in dual.centroid.T])
    distance = np.linalg.norm(moment / np.where(area > 0.0, area, 1.0), axis=0)
    # Rounding makes equal areas equal, whatever the order in which they were summed.
    order = np.lexsort((distance, -np.round(area, 9)))
    rank = np.empty(n, dtype=np.int64)
    rank[order] = np.arange(n)
    return rank[part]


def _sums(group: IntArray, x: FloatArray, n: int) -> FloatArray:
    """Sum x over each of n groups."""
    return np.bincount(group, weights=x, minlength=n).astype(np.float64)
