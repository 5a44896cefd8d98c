"""A stage in: one animation for each of its meshes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from pxr import Usd, UsdGeom

from meshmark.animation import Asset, LeftOut, MeshAnimation
from meshmark.errors import InputError, UsageError
from meshmark.usd.diagnostics import caught
from meshmark.usd.frames import StageFrames, blamed
from meshmark.usd.geometry import local_points, sample_times, topology_varies
from meshmark.usd.opening import OpenStage, open_stage
from meshmark.usd.prims import hidden_prototypes, is_guide, mesh_prims, missing_layers, notes

READER = "usd"
NOT_DEFINED = "not defined, and shown by a point instancer all the same"


def read_stage(source: str, prims: Sequence[str] | None = None) -> Asset:
    """Read the meshes of a .usd, .usda, .usdc or .usdz file.

    Every mesh the stage shows is read, at the times its points are sampled at, in world space;
    subdivision surfaces as their control cage. Purposes `default`, `render` and `proxy` are
    read, because all three leave the house with the stage; `guide` is left out with a note.
    Meshes inside instances and skinned ones (in their rest pose) are read with a note.

    Only the first frame of each mesh is looked at now, the others when they are asked for; see
    `meshmark.validation.check` for a look at all.

    Parameters
    ----------
    source : str
        The file.
    prims : sequence of str, optional
        Paths of the meshes wanted, of any purpose. Without it, an unfit mesh beside fit ones
        is left out with a note.

    Returns
    -------
    Asset
        Its notes hold what pxr warned of and which meshes were left out, and why; the latter
        it also lists, together with prims that lack a layer and prototypes nobody defines.

    Raises
    ------
    InputError
        If the file cannot be read or holds no mesh, if a wanted mesh is unfit, or all are.
    UsageError
        If a wanted mesh does not exist.
    """
    # Layers are opened, and values unpacked, whenever pxr first needs them.
    with caught(source):
        return _read(source, prims)


def _read(source: str, prims: Sequence[str] | None) -> Asset:
    opened = open_stage(source)
    found = {str(prim.GetPath()): prim for prim in mesh_prims(opened.stage)}
    if not found:
        raise InputError("the stage holds no mesh", source=source)
    if prims is not None:
        _require(source, prims, found)
        meshes = tuple(_read_mesh(source, found[path]) for path in dict.fromkeys(prims))
        return _asset(source, opened, meshes, ())
    meshes, left_out = _read_fit(source, found.values())
    unseen = (
        *(LeftOut(path, reason) for path, reason in missing_layers(opened.stage)),
        *(LeftOut(str(prim.GetPath()), NOT_DEFINED) for prim in hidden_prototypes(opened.stage)),
    )
    return _asset(source, opened, meshes, left_out, unseen)


def _require(source: str, wanted: Iterable[str], found: dict[str, Usd.Prim]) -> None:
    for path in wanted:
        if path not in found:
            known = ", ".join(list(found)[:10])
            raise UsageError(f"no mesh at {path}; there is {known}", source=source)


def _read_fit(
    source: str, prims: Iterable[Usd.Prim]
) -> tuple[tuple[MeshAnimation, ...], tuple[LeftOut, ...]]:
    meshes: list[MeshAnimation] = []
    errors: list[InputError] = []
    guides: list[LeftOut] = []
    for prim in prims:
        if is_guide(prim):
            guides.append(LeftOut(str(prim.GetPath()), "purpose guide", guide=True))
            continue
        try:
            meshes.append(_read_mesh(source, prim))
        except InputError as error:
            errors.append(error)
    if not meshes:
        raise errors[0] if errors else InputError("all meshes are guides", source=source)
    unfit = [LeftOut(str(error.prim), error.message) for error in errors]
    return tuple(meshes), (*guides, *unfit)


def _read_mesh(source: str, prim: Usd.Prim) -> MeshAnimation:
    path = str(prim.GetPath())
    with blamed(source, path):
        times = sample_times(prim)
        varies = topology_varies(prim, times)
        said, in_place = notes(prim), not prim.IsInstanceProxy()
        dtype = local_points(prim, float(times[0])).dtype.name
    frames = StageFrames(source, path, tuple(times.tolist()), varies)
    frames.frame(0)
    return MeshAnimation(
        times=times,
        source=frames,
        constant_topology=not varies,
        prim=path,
        origin=source,
        notes=said,
        in_place=in_place,
        dtype=dtype,
    )


def _asset(
    source: str,
    opened: OpenStage,
    meshes: tuple[MeshAnimation, ...],
    left_out: tuple[LeftOut, ...],
    unseen: tuple[LeftOut, ...] = (),
) -> Asset:
    stage = opened.stage
    return Asset(
        source=source,
        meshes=meshes,
        reader=READER,
        up_axis=str(UsdGeom.GetStageUpAxis(stage)),
        meters_per_unit=float(UsdGeom.GetStageMetersPerUnit(stage)),
        fps=float(stage.GetTimeCodesPerSecond()),
        notes=(
            *opened.warnings,
            *(f"{each.prim}: left out: {each.reason}" for each in left_out),
        ),
        left_out=(*left_out, *unseen),
    )
