"""A whole new stage out, from an animation of any origin."""

from __future__ import annotations

from collections.abc import Container
from pathlib import Path

import numpy as np
from pxr import Sdf, Tf, UsdGeom

from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.precision import stored
from meshmark.mesh.topology import Topology
from meshmark.usd.layers import POINT_TYPES, StreamedLayer, extent, new_layer
from meshmark.usd.names import READER
from meshmark.usd.reading import read_stage
from meshmark.usd.stamp import NO_STAMPS, Stamps
from meshmark.usd.stamping import write_stamp

NAMELESS = "Mesh"


def write_stage(asset: Asset, output: Path, stamps: Stamps = NO_STAMPS) -> None:
    """Write the meshes of an asset as a new stage that depends on no other file.

    Every mesh becomes a `Mesh` prim at its own path, below `Xform` prims that move nothing:
    points are written in world space, in double precision where the source has that and single
    precision elsewhere, at the asset's time codes; faces once, or with
    every frame where they change. Names USD does not allow are altered to ones it does, and a
    mesh without a name becomes `/Mesh`. Frames are asked for one at a time. Equal input gives
    equal bytes.

    Parameters
    ----------
    asset : Asset
        From any reader.
    output : Path
        A .usd or .usdc file (crate), or .usda (text). Replaced in one step if it exists.
    stamps : mapping of str to Stamp
        What meshes, by their paths in the asset, are to say of their marks.

    Raises
    ------
    OutputError
        If the place cannot be written to, or a point is not finite or beyond what its type holds.
    """
    with new_layer(output) as target:
        _describe(target.layer, asset)
        paths = stage_paths(asset)
        for path, mesh in zip(paths, asset.meshes, strict=True):
            _write_mesh(target, path, mesh)
            if mesh.prim in stamps:
                write_stamp(target.layer.GetPrimAtPath(path), stamps[mesh.prim])
        if paths:
            target.layer.defaultPrim = paths[0].GetPrefixes()[0].name


def stage_paths(asset: Asset) -> list[Sdf.Path]:
    """List the path that `write_stage` gives each mesh: a valid one, and each its own."""
    taken: dict[Sdf.Path, None] = {}
    for mesh in asset.meshes:
        taken[_free(_valid(mesh.prim), taken)] = None
    return list(taken)


def as_stage(asset: Asset, place: Path) -> Asset:
    """Return an asset of a stage as it is, and any other as written to `place` and read back.

    Raises
    ------
    OutputError
        See `write_stage`.
    """
    if asset.reader == READER:
        return asset
    write_stage(asset, place)
    return read_stage(str(place))


def _describe(layer: Sdf.Layer, asset: Asset) -> None:
    root = layer.pseudoRoot
    root.SetInfo(UsdGeom.Tokens.upAxis, asset.up_axis)
    root.SetInfo(UsdGeom.Tokens.metersPerUnit, asset.meters_per_unit)
    layer.timeCodesPerSecond = asset.fps
    layer.framesPerSecond = asset.fps
    times = np.concatenate([mesh.times for mesh in asset.meshes] or [np.empty(0)])
    times = times[np.isfinite(times)]
    if times.size:
        layer.startTimeCode = float(times.min())
        layer.endTimeCode = float(times.max())


def _write_mesh(target: StreamedLayer, path: Sdf.Path, mesh: MeshAnimation) -> None:
    prim = _mesh_prim(target.layer, path)
    types = Sdf.ValueTypeNames
    # Half precision was enough in the prim's own space, but need not be in world space.
    dtype = np.promote_types(mesh.dtype, np.float32)
    points = Sdf.AttributeSpec(prim, "points", POINT_TYPES[dtype.type])
    box = Sdf.AttributeSpec(prim, "extent", types.Float3Array)
    counts = Sdf.AttributeSpec(prim, "faceVertexCounts", types.IntArray)
    indices = Sdf.AttributeSpec(prim, "faceVertexIndices", types.IntArray)
    scheme = Sdf.AttributeSpec(prim, "subdivisionScheme", types.Token, Sdf.VariabilityUniform)
    scheme.default = UsdGeom.Tokens.none
    faces: Topology | None = None
    for frame in mesh:
        if faces is None or not mesh.constant_topology:
            faces = frame.topology
            time = np.nan if mesh.constant_topology else frame.time
            target.set_integers(counts, time, faces.counts)
            target.set_integers(indices, time, faces.indices)
        P = stored(frame.points, dtype, source=mesh.origin, prim=mesh.prim, time=frame.time)
        target.set_vectors(points, frame.time, P)
        target.set_vectors(box, frame.time, extent(P))


def _mesh_prim(layer: Sdf.Layer, path: Sdf.Path) -> Sdf.PrimSpec:
    for prefix in path.GetPrefixes():
        prim = layer.GetPrimAtPath(prefix) or Sdf.CreatePrimInLayer(layer, prefix)
        prim.specifier = Sdf.SpecifierDef
        prim.typeName = prim.typeName or "Xform"
    prim.typeName = "Mesh"
    return prim


def _valid(prim: str) -> Sdf.Path:
    names = [name for name in prim.split("/") if name] or [NAMELESS]
    path = Sdf.Path.absoluteRootPath
    for name in names:
        path = path.AppendChild(Tf.MakeValidIdentifier(name))
    return path


def _free(path: Sdf.Path, taken: Container[Sdf.Path]) -> Sdf.Path:
    free, n = path, 2
    while free in taken:
        free = path.ReplaceName(f"{path.name}_{n}")
        n += 1
    return free
