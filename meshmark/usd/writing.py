"""An override layer out: it sublayers its source, and holds moved points and what hangs on them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pxr import Sdf, Usd

from meshmark.errors import OutputError, UsageError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.usd.authoring import (
    MarkedFrames,
    Witness,
    author_marked_points,
    author_marked_rest,
)
from meshmark.usd.blend_shapes import TARGETS, shapes_of
from meshmark.usd.following import author_followed
from meshmark.usd.influences import INDICES, WEIGHTS
from meshmark.usd.layers import StreamedLayer, lay_over, new_layer
from meshmark.usd.names import BAKE, FOLLOW, KEEP, REST_POSE
from meshmark.usd.opening import open_stage
from meshmark.usd.points import MeshPoints, StagePoints
from meshmark.usd.reach import refuse_to_overwrite
from meshmark.usd.specs import author_classes, over
from meshmark.usd.stamp import NO_STAMPS, Stamp, Stamps
from meshmark.usd.stamping import write_stamp
from meshmark.usd.variant_places import Place, Places, find_places
from meshmark.usd.velocities import author_velocities


@dataclass(frozen=True)
class Override:
    """What there is to know of an override layer.

    Parameters
    ----------
    in_variants : mapping of str to Place
        By their paths, the meshes that are marked in the variants selected, and in no other.
    shared : tuple of str
        Blend shapes that stay, though points of a rest pose slid: several meshes share them.
    """

    in_variants: Mapping[str, Place]
    shared: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return it as JSON values, as entries of the manifest."""
        told = [
            {
                "prim": prim,
                "marked_in": list(map(str, place.variants)),
                "as_they_are": list(map(str, place.others)),
            }
            for prim, place in self.in_variants.items()
        ]
        shared = {"shared_shapes": list(self.shared)} if self.shared else {}
        return shared | ({"variants": told} if told else {})


def write_override(
    original: Asset,
    marked: Asset,
    output: Path,
    *,
    skel: str = BAKE,
    stamps: Stamps = NO_STAMPS,
    primvars: str = FOLLOW,
    places: Places | None = None,
) -> Override:
    """Write a layer over the original's file with the points of the marked meshes.

    The layer holds only `over` specs with `points` and `extent`, at every time the source has
    points (its default where it has no samples), what hangs on points and follows them
    (`meshmark.usd.following`), and the metadata without which it would not look the same as the
    source. Of a rigged mesh it holds what it takes to bake it, or its
    rest pose; see `meshmark.usd.authoring`. The source's files are only read. Equal input gives
    equal bytes.

    Parameters
    ----------
    original : Asset
        As read by `read_stage`; only where it was read from matters.
    marked : Asset
        Any of its meshes with points moved, world space, possibly only some frames. Of meshes
        that instances share, the first counts.
    output : Path
        A .usd or .usdc file (crate), or .usda (text). Replaced in one step if it exists.
    skel : {"bake", "rest"}
        Whether rigged meshes are baked, or keep their rigs, and have their rest poses marked.
    stamps : mapping of str to Stamp
        What meshes, by their paths, are to say of their marks.
    primvars : {"follow", "keep"}
        Whether what hangs on points that slid gets the values of their new places.
    places : Places, optional
        Of the marked meshes, if they are known.

    Returns
    -------
    Override
        Which meshes are marked in one variant only; see `meshmark.usd.variant_places`.

    Raises
    ------
    OutputError
        If the place cannot be written to, is part of the source, or nothing can be marked there.
    UsageError
        If the marked meshes do not fit the original.
    """
    opened = open_stage(original.source, original.variants)
    stage = opened.stage
    refuse_to_overwrite(original.source, output)
    pairs = [(require_prim(stage, mesh, original.source), mesh) for mesh in marked.meshes]
    if places is None:
        places = find_places(original, opened.points, [prim for prim, _ in pairs])
    # Of meshes that instances share, the first.
    found = {
        place.path: (prim, mesh, place)
        for prim, mesh in reversed(pairs)
        if (place := places.found.get(mesh.prim)) is not None
    }
    if not found:
        raise OutputError(
            "every marked mesh is inside an instance, and said where no layer can override it; "
            "write a flattened deliverable instead",
            source=original.source,
        )
    with new_layer(output) as target:
        lay_over(target.layer, stage, original, output)
        author_classes(target.layer, places.classes, stage)
        for prim, mesh, place in reversed(found.values()):
            spec = over(target.layer, place.path, stage, places.classes)
            points = opened.points.of(prim)
            stamp = stamps.get(mesh.prim)
            # Inside a variant, influences that are said for all would win.
            kept = place.elsewhere
            bound = not place.variants and kept.isdisjoint((INDICES, WEIGHTS, TARGETS))
            frames = author_marked(
                target,
                spec,
                points,
                mesh,
                skel,
                primvars,
                stamp,
                bound=bound,
                shared=opened.points.shared_shapes,
            )
            if primvars == FOLLOW:
                author_followed(target, spec, points, frames, posed=skel == BAKE, kept=kept)
                author_velocities(target, spec, points, frames)
    return Override(
        {mesh.prim: place for _, mesh, place in reversed(found.values()) if place.variants},
        staying_shapes(opened.points, marked, skel, primvars),
    )


def staying_shapes(points: StagePoints, marked: Asset, skel: str, primvars: str) -> tuple[str, ...]:
    """List the blend shapes that stay where those of one mesh alone would follow its points."""
    if skel != REST_POSE or primvars != FOLLOW:
        return ()
    prims = (points.stage.GetPrimAtPath(mesh.prim) for mesh in marked.meshes)
    bound = {path for prim in prims if points.of(prim).rig for path in shapes_of(prim)}
    return tuple(sorted(map(str, bound & points.shared_shapes)))


def author_marked(
    target: StreamedLayer,
    spec: Sdf.PrimSpec,
    points: MeshPoints,
    marked: MeshAnimation,
    skel: str,
    primvars: str,
    stamp: Stamp | None = None,
    witness: Witness | None = None,
    *,
    bound: bool = True,
    shared: frozenset[Sdf.Path] = frozenset(),
) -> MarkedFrames:
    """Give a prim its marked points, or if it is rigged and `skel` says so, its rest pose.

    Normals that follow are left to `author_followed`. And a stamp, if it is to have one.

    Parameters
    ----------
    bound : bool
        Whether influences of joints, and blend shapes, can be written for it.
    shared : frozenset of Sdf.Path
        Blend shapes that are not its own.
    """
    if skel == REST_POSE and points.rig is not None:
        follow = bound and primvars == FOLLOW
        frames = author_marked_rest(
            target, spec, points, marked, witness, follow=follow, kept=shared
        )
    else:
        normals = primvars == KEEP
        frames = author_marked_points(target, spec, points, marked, witness, normals=normals)
    if stamp is not None:
        write_stamp(spec, stamp)
    return frames


def require_prim(stage: Usd.Stage, mesh: MeshAnimation, source: str) -> Usd.Prim:
    """Find the prim a marked mesh belongs to.

    Raises
    ------
    UsageError
        If the stage has none there.
    """
    prim = stage.GetPrimAtPath(mesh.prim)
    if not prim:
        raise UsageError("the source has no such prim", source=source, prim=mesh.prim)
    return prim
