"""A stage in: one animation for each of its meshes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from pxr import Usd, UsdGeom

from meshmark.errors import InputError, UsageError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.asset import Asset, LeftOut
from meshmark.mesh.frame_agreement import agreed
from meshmark.mesh.precision import rounding
from meshmark.usd.diagnostics import caught, unopened
from meshmark.usd.frames import StageFrames, blamed
from meshmark.usd.geometry import shapes
from meshmark.usd.instances import sharing
from meshmark.usd.names import READER
from meshmark.usd.opening import OpenStage, open_stage, resolved
from meshmark.usd.prims import (
    hidden_prototypes,
    is_guide,
    mesh_prims,
    missing_layers,
    not_looked_at,
    note_on_sharing,
    notes,
)

NOT_DEFINED = "not defined, and shown by a point instancer all the same"


def read_stage(
    source: str,
    prims: Sequence[str] | None = None,
    variants: Sequence[str] = (),
    *,
    strict: bool = True,
) -> Asset:
    """Read the meshes of a .usd, .usda, .usdc or .usdz file.

    Every mesh the stage shows is read, at the times its points are sampled at, in world space;
    subdivision surfaces as their control cage. Rigged ones (UsdSkel) are read as joints and blend
    shapes pose them, at the times these, points and transforms are sampled at; in the rest pose,
    if the rig cannot pose them. Purposes `default`, `render` and `proxy` are read, because all
    three leave the house with the stage; `guide` is left out with a note. Meshes inside instances
    and rigged ones are read with a note.

    Of the frames only the faces and the number of points are looked at now, and one frame that can
    be read; the others when they are asked for. Where almost all have the same faces, those that
    do not are bad frames, which raise when they are asked for, as do frames that cannot be read;
    see `meshmark.mesh.checks.bad_frames`. Faces that are none are left out with a note.

    Parameters
    ----------
    source : str
        The file.
    prims : sequence of str, optional
        Paths of the meshes wanted, of any purpose. Without it, an unfit mesh beside fit ones
        is left out with a note.
    variants : sequence of str
        What to select that the stage does not select itself: `SET=NAME` for all prims that have
        such a variant, `PRIM{SET=NAME}` for one.
    strict : bool
        Whether there must be such variants.

    Returns
    -------
    Asset
        Its notes hold what pxr warned of, such as layers that are missing, which meshes were
        left out, and why, and how much there is beside meshes. It also lists those left out,
        together with prims that lack a layer and prototypes nobody defines.

    Raises
    ------
    InputError
        If the file cannot be read or holds no mesh, if a wanted mesh is unfit, or all are.
    UsageError
        If a wanted mesh or variant does not exist.
    """
    opened = open_stage(source, resolved(source, variants, strict=strict))
    try:
        # Layers are opened, and values unpacked, whenever pxr first needs them.
        with caught(source) as said:
            asset = _read(source, opened, prims)
    except InputError as error:
        # What is wrong with a mesh may be what is missing from it.
        missing = unopened([*opened.warnings, *said])
        if not missing:
            raise
        message = f"{error.message}; could not open {', '.join(missing)}"
        raise type(error)(message, source=source, prim=error.prim, time=error.time) from None
    return replace(asset, notes=tuple(dict.fromkeys((*opened.warnings, *said, *asset.notes))))


def _read(source: str, opened: OpenStage, prims: Sequence[str] | None) -> Asset:
    stage = opened.stage
    found = {str(prim.GetPath()): prim for prim in mesh_prims(stage)}
    if not found:
        raise InputError("the stage holds no mesh", source=source)
    shared = sharing(opened.points, found.values())
    if prims is None:
        meshes, left_out = _read_fit(source, opened, found.values(), shared)
        unseen = _unseen(stage)
    else:
        _require(source, prims, found)
        meshes = tuple(
            _read_mesh(source, opened, found[path], shared) for path in dict.fromkeys(prims)
        )
        left_out, unseen = (), ()
    told = (f"{each.prim}: left out: {each.reason}" for each in left_out)
    return Asset(
        source=source,
        meshes=meshes,
        reader=READER,
        up_axis=str(UsdGeom.GetStageUpAxis(stage)),
        meters_per_unit=float(UsdGeom.GetStageMetersPerUnit(stage)),
        fps=float(stage.GetTimeCodesPerSecond()),
        notes=(*told, *not_looked_at(stage)),
        left_out=(*left_out, *unseen),
        variants=opened.variants,
    )


def _unseen(stage: Usd.Stage) -> tuple[LeftOut, ...]:
    return (
        *(LeftOut(path, reason) for path, reason in missing_layers(stage)),
        *(LeftOut(str(prim.GetPath()), NOT_DEFINED) for prim in hidden_prototypes(stage)),
    )


def _require(source: str, wanted: Iterable[str], found: dict[str, Usd.Prim]) -> None:
    for path in wanted:
        if path not in found:
            known = ", ".join(list(found)[:10])
            raise UsageError(f"no mesh at {path}; there is {known}", source=source)


def _read_fit(
    source: str, opened: OpenStage, prims: Iterable[Usd.Prim], shared: Mapping[str, list[str]]
) -> tuple[tuple[MeshAnimation, ...], tuple[LeftOut, ...]]:
    meshes: list[MeshAnimation] = []
    errors: list[InputError] = []
    guides: list[LeftOut] = []
    for prim in prims:
        if is_guide(prim):
            guides.append(LeftOut(str(prim.GetPath()), "purpose guide", guide=True))
            continue
        try:
            meshes.append(_read_mesh(source, opened, prim, shared))
        except InputError as error:
            errors.append(error)
    if not meshes:
        raise errors[0] if errors else InputError("all meshes are guides", source=source)
    unfit = [LeftOut(str(error.prim), error.message) for error in errors]
    return tuple(meshes), (*guides, *unfit)


def _read_mesh(
    source: str, opened: OpenStage, prim: Usd.Prim, shared: Mapping[str, list[str]]
) -> MeshAnimation:
    path = str(prim.GetPath())
    with blamed(source, path):
        points = opened.points.of(prim)
        times = points.times()
        most = agreed(shapes(prim, times))
        said, alike = (*notes(prim), *points.notes), shared.get(path)
    reference, strays = (None, ()) if most is None else most
    frames = StageFrames(source, path, tuple(times.tolist()), reference, strays, opened.variants)
    index, first = _first_readable(frames)
    with blamed(source, path):
        stored = points.local(frames.times[index])
    flaw = first.topology.left_out
    if alike is not None:
        said = (note_on_sharing(path, alike), *said)
    return MeshAnimation(
        times=times,
        source=frames,
        constant_topology=reference is not None,
        prim=path,
        origin=source,
        notes=(*said, flaw) if flaw else said,
        in_place=alike != [],
        shared=alike[0] if alike else "",
        dtype=stored.dtype.name,
        rounding=rounding(stored, first.faces),
        flaw=flaw,
    )


def _first_readable(frames: StageFrames) -> tuple[int, Frame]:
    """Find a frame that can be read; the first one's error if none can be."""
    errors: list[InputError] = []
    for index in range(len(frames.times)):
        try:
            return index, frames.frame(index)
        except InputError as error:
            errors.append(error)
    raise errors[0]
