"""Texture coordinates of a mesh prim, as its triangles see them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from meshmark.arrays import FloatArray
from meshmark.mesh.topology import triangulate
from meshmark.usd.frames import blamed
from meshmark.usd.geometry import (
    backwards,
    inside_out,
    local_points,
    polygons,
    sample_times,
    time_code,
)
from meshmark.usd.opening import open_stage
from meshmark.usd.primvars import PAIRS
from meshmark.usd.skinned_normals import BY_POINT

# The name that writers of USD agree on; any other of the type will do where it is missing.
USUAL = "st"
TYPES = (
    Sdf.ValueTypeNames.TexCoord2fArray,
    Sdf.ValueTypeNames.TexCoord2dArray,
    Sdf.ValueTypeNames.TexCoord2hArray,
)


@dataclass(frozen=True)
class TextureCoordinates:
    """The texture coordinates of a mesh prim, asked by time; see `read_texture_coordinates`."""

    source: str
    prim: str
    variants: tuple[str, ...] = ()

    def __call__(self, time: float) -> FloatArray | None:
        """Read them at a time."""
        return read_texture_coordinates(self.source, self.prim, self.variants, time)


def read_texture_coordinates(
    source: str, prim: str, variants: Sequence[str] = (), time: float | None = None
) -> FloatArray | None:
    """Read the texture coordinates of a mesh.

    Parameters
    ----------
    source : str
        The stage's file.
    prim : str
        Path of the mesh.
    variants : sequence of str
        Those to select; see `open_stage`.
    time : float, optional
        When; the first time of its points where not given.

    Returns
    -------
    (F, 3, 2) float64 or None
        For each corner of the triangles that `Topology.triangles` lists; None if the mesh has
        no coordinates of points or of corners, or they do not fit it.

    Raises
    ------
    InputError
        If the stage cannot be read.
    """
    stage = open_stage(source, variants).stage
    with blamed(source, prim):
        found = stage.GetPrimAtPath(prim)
        time = float(sample_times(found)[0]) if time is None else time
        primvar = _primvar(found)
        return None if primvar is None else _by_triangle(found, primvar, time)


def _primvar(prim: Usd.Prim) -> UsdGeom.Primvar | None:
    """Choose the coordinates: the usual name, else the first of the type."""
    offered = [
        primvar
        for primvar in UsdGeom.PrimvarsAPI(prim).FindPrimvarsWithInheritance()
        if primvar.GetTypeName() in TYPES
        or (primvar.GetPrimvarName() == USUAL and primvar.HasValue())
    ]
    offered.sort(key=lambda primvar: (primvar.GetPrimvarName() != USUAL, primvar.GetName()))
    return offered[0] if offered else None


def _by_triangle(prim: Usd.Prim, primvar: UsdGeom.Primvar, time: float) -> FloatArray | None:
    code, mesh = time_code(time), UsdGeom.Mesh(prim)
    counts, points = polygons(mesh, code)
    n_points = len(local_points(prim, time))
    by_point = primvar.GetInterpolation() in BY_POINT
    if not by_point and primvar.GetInterpolation() != UsdGeom.Tokens.faceVarying:
        return None
    value = primvar.ComputeFlattened(code)
    if not isinstance(value, PAIRS):
        return None
    uv = np.asarray(value, dtype=np.float64)
    if uv.shape != (n_points if by_point else len(points), 2) or not np.all(np.isfinite(uv)):
        return None
    corner = np.arange(len(points))
    if inside_out(prim, time):
        corner = backwards(counts, corner)
    corner = triangulate(counts, corner)
    return uv[points[corner]] if by_point else uv[corner]
