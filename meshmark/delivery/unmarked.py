"""What of an asset holds no mark, and whether it may leave the house all the same."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from dataclasses import replace

from meshmark.errors import CapacityError, InputError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset, LeftOut
from meshmark.mesh.checks import bad_frames, check
from meshmark.mesh.geometry import face_areas

# What is smaller than this, beside marked meshes, is worth nothing without them.
CONSIDERABLE = 0.1
ALL = "all"
INSTANCED = "inside an instance, which a layer cannot override; --deliver can mark it"
UNASKED = "not asked for with --prim"


def split_fit(asset: Asset) -> Asset:
    """Look at every frame, and leave out the meshes that no scheme could mark.

    Raises
    ------
    InputError
        If none is left; it says what is wrong with the first.
    """
    fit: list[MeshAnimation] = []
    errors: list[InputError] = []
    for mesh in asset.meshes:
        try:
            check(mesh)
        except InputError as error:
            errors.append(error)
        else:
            fit.append(mesh)
    if not fit:
        raise errors[0]
    unfit = (LeftOut(str(error.prim), _told(error)) for error in errors)
    return replace(asset, meshes=tuple(fit), left_out=(*asset.left_out, *unfit))


def unasked(asset: Asset, wanted: Sequence[str]) -> tuple[LeftOut, ...]:
    """List what an asset holds besides the meshes that are wanted; nothing if all are."""
    others = (LeftOut(mesh.prim, UNASKED) for mesh in asset.meshes if mesh.prim not in wanted)
    return (*others, *asset.left_out) if wanted else ()


def _told(error: InputError) -> str:
    known = error.time is not None and error.time == error.time
    return f"frame {error.time:g}: {error.message}" if known else error.message


def split_in_place(asset: Asset, reached: Container[str] | None = None) -> Asset:
    """Leave out the meshes an override layer cannot reach, and of those that it shares all but one.

    Parameters
    ----------
    reached : container of str, optional
        The meshes that it reaches, if it is known to reach no others.

    Raises
    ------
    CapacityError
        If no mesh is left.
    """
    meshes: dict[str, MeshAnimation] = {}
    beyond: list[LeftOut] = []
    for mesh in asset.meshes:
        if not mesh.in_place or (reached is not None and mesh.prim not in reached):
            beyond.append(LeftOut(mesh.prim, INSTANCED))
        else:
            meshes.setdefault(mesh.shared or mesh.prim, mesh)
    if not meshes:
        raise CapacityError(INSTANCED, source=asset.source, prim=asset.meshes[0].prim)
    left_out = (*asset.left_out, *beyond)
    return replace(asset, meshes=tuple(meshes.values()), left_out=left_out)


def require_allowed(asset: Asset, allowed: Sequence[str]) -> None:
    """Refuse to deliver an asset of which something was left out that nobody allowed.

    Raises
    ------
    CapacityError
        Naming the first, and how many there are.
    """
    _refuse(asset, [each for each in asset.left_out if not _allows(allowed, each.prim)])


def require_extent(asset: Asset, allowed: Sequence[str]) -> None:
    """Refuse to deliver frames in which a mesh is scaled to nothing, unless somebody allows it.

    They hold no mark; where a transform scales the mesh, its points are there all the same.

    Raises
    ------
    CapacityError
        Naming the first, and how many meshes there are.
    """
    loose = []
    for mesh in asset.meshes:
        if not _allows(allowed, mesh.prim) and (empty := bad_frames(mesh)):
            time, reason = mesh.times[empty[0][0]], empty[0][1].message
            loose.append(LeftOut(mesh.prim, f"{reason} in {len(empty)} frames, {time:g} first"))
    _refuse(asset, loose)


def require_small(asset: Asset, skipped: Sequence[LeftOut], allowed: Sequence[str]) -> None:
    """Refuse to deliver an asset if the meshes that can hold no mark are a good part of it.

    Parameters
    ----------
    asset : Asset
        All its meshes, those skipped among them.
    skipped : sequence of LeftOut
        Those that can hold none.
    allowed : sequence of str
        Paths of prims that may go out unmarked, with all below them; or `all`.

    Raises
    ------
    CapacityError
        If those that nobody allowed have more than a tenth of the points, or of the area, of the
        first frame.
    """
    loose = [each for each in skipped if not _allows(allowed, each.prim)]
    names = {each.prim for each in loose}
    first = {mesh.prim: mesh[0] for mesh in asset.meshes}
    points = {prim: frame.topology.n_points for prim, frame in first.items()}
    areas = {
        prim: float(face_areas(frame.points, frame.faces).sum()) for prim, frame in first.items()
    }
    for sizes in (points, areas):
        if sum(sizes[prim] for prim in names) > CONSIDERABLE * sum(sizes.values()):
            _refuse(asset, loose)


def require_held(asset: Asset, frames: Iterable[LeftOut], allowed: Sequence[str]) -> None:
    """Refuse to deliver marked meshes of which some frames can hold no mark.

    Raises
    ------
    CapacityError
        Naming the first that nobody allowed, and how many there are.
    """
    _refuse(asset, [each for each in frames if not _allows(allowed, each.prim)])


def _allows(allowed: Iterable[str], prim: str) -> bool:
    return any(path in (ALL, prim) or prim.startswith(f"{path.rstrip('/')}/") for path in allowed)


def _refuse(asset: Asset, unmarked: Sequence[LeftOut]) -> None:
    if not unmarked:
        return
    first, others = unmarked[0], len(unmarked) - 1
    more = f" (and {others} more)" if others else ""
    raise CapacityError(
        f"would be delivered unmarked{more}: {first.reason}; --allow-unmarked {first.prim} "
        "lets it go",
        source=asset.source,
        prim=first.prim,
    )
