"""A flattened deliverable out: one file in which no unmarked point survives."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pxr import Sdf, Usd

from meshmark.errors import UsageError
from meshmark.files.places import assets_folder
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.usd.asset_paths import anchor_asset_paths
from meshmark.usd.authoring import unmarked_times
from meshmark.usd.checking import require_no_traces
from meshmark.usd.diagnostics import caught
from meshmark.usd.flattening import flattened, make_instances_editable
from meshmark.usd.following import author_followed
from meshmark.usd.layers import StreamedLayer, lay_over, new_layer, replacing, usd_output_errors
from meshmark.usd.metadata import copy_layer_metadata, strip_metadata
from meshmark.usd.names import BAKE, FOLLOW
from meshmark.usd.opening import open_stage
from meshmark.usd.points import MeshPoints, StagePoints
from meshmark.usd.reach import refuse_to_overwrite
from meshmark.usd.stamp import NO_STAMPS, Stamps
from meshmark.usd.stamping import remove_stamps
from meshmark.usd.traces import Moved, Traces, replace_traces
from meshmark.usd.velocities import author_velocities
from meshmark.usd.writing import author_marked, require_prim, staying_shapes


@dataclass(frozen=True)
class Delivery:
    """What was done to a deliverable beyond marking it.

    Parameters
    ----------
    moved : tuple of Moved
        Copies of unmarked points elsewhere in it, which got the marked ones.
    removed : tuple of str
        What told of its origin.
    outside : tuple of str
        Paths to textures that lead out of the folder the deliverable lies in.
    shared : tuple of str
        Blend shapes that stay, though points of a rest pose slid: several meshes share them.
    """

    moved: tuple[Moved, ...] = ()
    removed: tuple[str, ...] = ()
    outside: tuple[str, ...] = ()
    shared: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return it as JSON values, as entries of the manifest."""
        told = {
            "moved": [{"path": each.path, "prim": each.prim} for each in self.moved],
            "removed": list(self.removed),
            "outside": list(self.outside),
        }
        shared = {"shared_shapes": list(self.shared)} if self.shared else {}
        return shared | {"delivery": told}


def write_flattened(
    original: Asset,
    marked: Asset,
    output: Path,
    *,
    keep_metadata: bool = False,
    skel: str = BAKE,
    stamps: Stamps = NO_STAMPS,
    primvars: str = FOLLOW,
) -> Delivery:
    """Write the original's stage as one self-contained file with the points of the marked meshes.

    The stage is flattened: what it shows stays, what it is composed from (sublayers, references,
    payloads, the variants not selected, classes, deactivated prims, value clips) goes. Then

    - instances become ordinary prims, because every copy is its own mesh to mark;
    - the default of points that have time samples goes: it would be an unmarked pose;
    - copies of the points of marked meshes, such as a reference pose in a primvar or a mesh that
      was not marked, get the marked points: whatever their type, scale, place and order, and
      where points are missing (`meshmark.delivery.copies`, `meshmark.delivery.clouds`);
    - what tells of the studio goes (`meshmark.usd.metadata`), unless it is to be kept;
    - paths to textures become relative to the output where they can; textures that lie inside a
      .usdz are copied into the folder `<name of output>.assets` beside the output; paths to
      layers, as in `assetInfo`, are removed.

    Meshes that are neither marked nor copies of marked ones stay as they are. Equal input gives
    equal bytes.

    Parameters
    ----------
    original : Asset
        As read by `read_stage`; only where it was read from matters.
    marked : Asset
        Meshes with points moved, world space, every frame. Meshes inside instances are welcome.
    output : Path
        A .usd or .usdc file (crate), or .usda (text). Replaced in one step if it exists.
    keep_metadata : bool
        Keep comments, authors, paths and whatever else tells where the stage comes from.
    skel : {"bake", "rest"}
        What becomes of rigged meshes; see `write_override`.
    stamps : mapping of str to Stamp
        What meshes, by their paths, are to say of their marks. No other stamp stays, unless
        metadata is to be kept.
    primvars : {"follow", "keep"}
        What becomes of what hangs on points; see `write_override`.

    Returns
    -------
    Delivery
        What was moved along, removed, and leads outside.

    Raises
    ------
    UsageError
        If a marked mesh lacks a frame its source has, or does not fit the original.
    OutputError
        If the place cannot be written to or is part of the source.
    """
    opened = open_stage(original.source, original.variants)
    refuse_to_overwrite(original.source, output)
    with caught(original.source):
        for mesh in marked.meshes:
            prim = require_prim(opened.stage, mesh, original.source)
            _require_every_frame(opened.points.of(prim), mesh)
    with replacing(output, assets_folder(output)) as beside, usd_output_errors(output):
        overlay = beside.with_name("marked.usdc")
        with new_layer(overlay) as target:
            lay_over(target.layer, opened.stage, original, overlay)
            traces = _author(target, opened.points, marked, skel, stamps, primvars)
        stage = Usd.Stage.Open(str(overlay))
        done = _export(stage, traces, output, beside, keep_metadata, stamps)
    return replace(done, shared=staying_shapes(opened.points, marked, skel, primvars))


def _export(
    stage: Usd.Stage,
    traces: Traces,
    output: Path,
    beside: Path,
    keep_metadata: bool,
    stamps: Stamps,
) -> Delivery:
    # The caller holds the stage until the flattened layer is gone: the other way round, every
    # array they share would be copied out of the mapped file.
    make_instances_editable(stage)
    layer = flattened(stage)
    removed = []
    if keep_metadata:
        copy_layer_metadata(layer, stage)
    else:
        removed = [*strip_metadata(layer, stage), *remove_stamps(layer, stamps.values())]
    moved = replace_traces(layer, traces)
    paths = anchor_asset_paths(layer, stage, output, assets_folder(beside), keep_metadata)
    layer.Export(str(beside))
    require_no_traces(beside, traces, output)
    return Delivery(tuple(moved), (*removed, *paths.cut), paths.outside)


def _author(
    target: StreamedLayer,
    points: StagePoints,
    marked: Asset,
    skel: str,
    stamps: Stamps,
    primvars: str,
) -> Traces:
    traces = Traces(points)
    authored = []
    for mesh in marked.meshes:
        own = points.of(points.stage.GetPrimAtPath(mesh.prim))
        stamp, witness = stamps.get(mesh.prim), traces.witness(mesh.prim)
        spec = Sdf.CreatePrimInLayer(target.layer, mesh.prim)
        frames = author_marked(
            target,
            spec,
            own,
            mesh,
            skel,
            primvars,
            stamp,
            witness,
            shared=points.shared_shapes,
        )
        if frames.rig is not None:
            traces.rigs[mesh.prim] = frames.rig
        authored.append((spec, own, frames))
    # A reference pose gets the marked points themselves, once those of all meshes are known.
    for spec, own, frames in authored if primvars == FOLLOW else ():
        author_followed(target, spec, own, frames, posed=skel == BAKE, is_copy=traces.has_copy)
        author_velocities(target, spec, own, frames)
    return traces


def _require_every_frame(points: MeshPoints, mesh: MeshAnimation) -> None:
    missing = unmarked_times(points, mesh)
    if missing.size:
        raise UsageError(
            f"{missing.size} frames of the source are not marked and would be delivered as they "
            "are: mark every frame, or write an override layer",
            source=mesh.origin,
            prim=mesh.prim,
            time=float(missing[0]),
        )
