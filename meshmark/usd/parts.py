"""Parts of a mesh as face subsets and display colours, over its stage, for a look in usdview."""

from __future__ import annotations

import colorsys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, UsdGeom

from meshmark.arrays import IntArray
from meshmark.errors import OutputError, UsageError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.usd.layers import StreamedLayer, lay_over, new_layer
from meshmark.usd.opening import open_stage
from meshmark.usd.reach import refuse_to_overwrite
from meshmark.usd.writing import require_prim

Float32Array = NDArray[np.float32]

FAMILY = "parts"
# Steps of the golden ratio never come near a hue already used; three tones (saturation and
# value) in turn keep apart what is nearest in hue.
HUE_STEP = (5**0.5 - 1) / 2
TONES = ((0.85, 1.0), (0.4, 1.0), (0.85, 0.5))


def write_parts(
    asset: Asset,
    labels_by_prim: Mapping[str, IntArray | Sequence[IntArray]],
    output: Path,
    frame_indices: Sequence[int] | None = None,
) -> None:
    """Write a layer over the asset's file that shows the parts of its meshes.

    Each part becomes a `GeomSubset` of faces (family `parts`, a partition), and each face gets
    its part's colour. A polygon belongs to the part of most of its triangles, of parts with
    equally many to the first.

    Parameters
    ----------
    asset : Asset
        As read by `read_stage`.
    labels_by_prim : mapping of str to (F,) int, or a sequence of them
        Part of each triangle of the mesh at that path; with `frame_indices`, for each of those
        frames.
    output : Path
        A .usd or .usdc file (crate), or .usda (text). Replaced in one step if it exists.
    frame_indices : sequence of int, optional
        Frames that the labels belong to; without it, labels hold for all time.

    Raises
    ------
    UsageError
        If the labels do not fit the mesh.
    OutputError
        If the place cannot be written to, or the mesh is inside an instance.
    """
    stage = open_stage(asset.source, asset.variants).stage
    refuse_to_overwrite(asset.source, output)
    with new_layer(output) as target:
        lay_over(target.layer, stage, asset, output)
        for path, labels in labels_by_prim.items():
            mesh = asset.mesh(path)
            prim = require_prim(stage, mesh, asset.source)
            if prim.IsInstanceProxy():
                raise OutputError(
                    "the mesh is inside an instance, which no layer can add to",
                    source=asset.source,
                    prim=path,
                )
            _write_prim(target, mesh, _polygon_labels(mesh, labels, frame_indices))
            if prim.HasAttribute("primvars:displayColor:indices"):
                _block_indices(target.layer, path)


def _polygon_labels(
    mesh: MeshAnimation,
    labels: IntArray | Sequence[IntArray],
    frame_indices: Sequence[int] | None,
) -> list[tuple[float, IntArray]]:
    """Pair each time with the part of every polygon, NaN for all time."""
    if frame_indices is None:
        return [(np.nan, _of_polygons(mesh, 0, np.asarray(labels)))]
    return [
        (float(mesh.times[index]), _of_polygons(mesh, index, np.asarray(of_frame)))
        for index, of_frame in zip(frame_indices, labels, strict=True)
    ]


def _of_polygons(mesh: MeshAnimation, index: int, labels: IntArray) -> IntArray:
    topology = mesh[index].topology
    polygon = np.repeat(np.arange(topology.counts.size), topology.counts - 2)
    if labels.shape != polygon.shape or labels.min() < 0:
        raise UsageError(
            f"labels {labels.shape} for {polygon.size} triangles; none may be negative",
            source=mesh.origin,
            prim=mesh.prim,
        )
    n_parts = int(labels.max()) + 1
    votes = np.bincount(polygon * n_parts + labels, minlength=topology.counts.size * n_parts)
    return votes.reshape(-1, n_parts).argmax(axis=1)


def _write_prim(
    target: StreamedLayer, mesh: MeshAnimation, labels: Sequence[tuple[float, IntArray]]
) -> None:
    over = Sdf.CreatePrimInLayer(target.layer, mesh.prim)
    n_parts = 1 + max(int(of_frame.max()) for _, of_frame in labels)
    types = Sdf.ValueTypeNames
    kind = Sdf.AttributeSpec(
        over, f"subsetFamily:{FAMILY}:familyType", types.Token, Sdf.VariabilityUniform
    )
    kind.default = UsdGeom.Tokens.partition
    colour = Sdf.AttributeSpec(over, "primvars:displayColor", types.Color3fArray)
    colour.SetInfo("interpolation", UsdGeom.Tokens.uniform)
    subsets = [_subset(over, f"part_{part}") for part in range(n_parts)]
    colours = palette(n_parts)
    for time, of_frame in labels:
        target.set_vectors(colour, time, colours[of_frame])
        for part, indices in enumerate(subsets):
            target.set_integers(indices, time, np.flatnonzero(of_frame == part))


def _subset(over: Sdf.PrimSpec, name: str) -> Sdf.AttributeSpec:
    types = Sdf.ValueTypeNames
    prim = Sdf.PrimSpec(over, name, Sdf.SpecifierDef, "GeomSubset")
    for attribute, value in (("elementType", UsdGeom.Tokens.face), ("familyName", FAMILY)):
        spec = Sdf.AttributeSpec(prim, attribute, types.Token, Sdf.VariabilityUniform)
        spec.default = value
    return Sdf.AttributeSpec(prim, "indices", types.IntArray)


def _block_indices(layer: Sdf.Layer, path: str) -> None:
    # The source indexes its own colours; those indices mean nothing to ours.
    prim = layer.GetPrimAtPath(path)
    spec = Sdf.AttributeSpec(prim, "primvars:displayColor:indices", Sdf.ValueTypeNames.IntArray)
    spec.default = Sdf.ValueBlock()


def palette(n: int) -> Float32Array:
    """Return n colours that are easy to tell apart, (n, 3), the first ones always the same."""
    rows = [colorsys.hsv_to_rgb(k * HUE_STEP % 1.0, *TONES[k % len(TONES)]) for k in range(n)]
    return np.array(rows, dtype=np.float32).reshape(n, 3)
