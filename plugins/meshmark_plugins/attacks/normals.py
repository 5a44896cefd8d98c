"""Normals that agree along seams, so that moves along them open no crack."""

from __future__ import annotations

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import vertex_normals
from meshmark.mesh.topology import weld


def welded_normals(V: FloatArray, F: IntArray) -> FloatArray:
    """Compute unit normals of vertices, the same ones where points coincide, (N, 3)."""
    welded, F, new = weld(V, F)
    return vertex_normals(welded, F)[new]
