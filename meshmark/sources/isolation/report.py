"""How a process tells another what it has read: arrays in one file, all else as JSON.

Whoever reads a hostile file may be led astray by it. Nothing it says is unpickled, and what does
not fit raises `ValueError`, `TypeError`, `KeyError` or `MeshmarkError`.
"""

from __future__ import annotations

import types
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np

from meshmark import errors
from meshmark.arrays import FloatArray
from meshmark.errors import MeshmarkError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.topology import Topology
from meshmark.sources.facts import texture_coordinates
from meshmark.sources.isolation.frames import (
    ArrayWriter,
    IsolatedFrames,
    Places,
    read_floats,
    read_integers,
    require_within,
)

Files = tuple[tuple[str, str], ...]

# What is not told as it is: known anyway, or made of arrays.
_APART = {"source", "meshes", "facts", "times"}


@dataclass(frozen=True)
class IsolatedFacts:
    """What else a process of its own has read of a source; see `animation.SourceFacts`.

    Parameters
    ----------
    files : tuple of (str, str)
        Absolute path and SHA-256 of each file it consists of.
    reach : tuple of str
        Every file it could use.
    path : Path
        The file of arrays.
    textures : mapping of str to (int, int) or MeshmarkError
        Where the texture coordinates of a mesh begin, and its number of triangles; or why they
        cannot be read. Those that are not there, or were not asked for, are missing.
    """

    files: Files
    reach: tuple[str, ...]
    path: Path
    textures: Mapping[str, tuple[int, int] | MeshmarkError]
    _owner: object = field(default=None, repr=False)

    def __getstate__(self) -> dict[str, object]:
        return {**vars(self), "_owner": None}

    def texture_coordinates(self, prim: str) -> FloatArray | None:
        """Return those of a mesh, (F, 3, 2), or raise what reading them raised."""
        found = self.textures.get(prim)
        if isinstance(found, MeshmarkError):
            raise copy(found)
        return None if found is None else read_floats(self.path, found[0], found[1], 3, 2)


def describe_error(error: MeshmarkError) -> dict[str, Any]:
    """Put an error into JSON values."""
    return {"kind": type(error).__name__, **vars(error)}


def error_from(told: Mapping[str, Any]) -> MeshmarkError:
    """Return the error that was described."""
    kind = getattr(errors, _checked(str, told["kind"]))
    if not issubclass(kind, MeshmarkError):
        raise TypeError("no error of ours")
    where = {name: _checked(str | None, told[name]) for name in ("source", "prim")}
    time = _checked(float | None, told["time"])
    return kind(_checked(str, told["message"]), **where, time=time)


def describe_asset(
    asset: Asset, arrays: ArrayWriter, *, textures: bool, beat: Callable[[], None]
) -> dict[str, Any]:
    """Put an asset into JSON values; read all its frames, and write them as arrays.

    Parameters
    ----------
    textures : bool
        Read texture coordinates, too.
    beat : callable
        Called after every frame.
    """
    meshes = []
    for mesh in asset.meshes:
        told = {**_simple(mesh), **_describe_frames(mesh, arrays, beat)}
        if textures:
            told["textures"] = _describe_textures(asset, mesh.prim, arrays)
            beat()
        meshes.append(told)
    return {**_simple(asset), "meshes": meshes}


def _simple(thing: Asset | MeshAnimation) -> dict[str, Any]:
    apart = _APART | ({"source"} if isinstance(thing, MeshAnimation) else set())
    return {
        item.name: getattr(thing, item.name) for item in fields(thing) if item.name not in apart
    }


def _describe_frames(
    mesh: MeshAnimation, arrays: ArrayWriter, beat: Callable[[], None]
) -> dict[str, Any]:
    table = np.zeros((len(mesh), 3), dtype=np.int64)
    topologies: list[tuple[int, int, int, int]] = []
    failed: dict[str, Any] = {}
    last: Topology | None = None
    for index in range(len(mesh)):
        try:
            frame = mesh[index]
        except errors.InputError as error:
            failed[str(index)] = describe_error(error)
        else:
            if last is None or not last.same_as(frame.topology):
                last = frame.topology
                topologies.append(
                    (
                        arrays.add(last.counts),
                        last.counts.size,
                        arrays.add(last.indices),
                        last.indices.size,
                    )
                )
            n_points = len(frame.points)
            table[index] = arrays.add(frame.points), n_points, len(topologies) - 1
        beat()
    return {
        "frames": len(mesh),
        "times": arrays.add(mesh.times),
        "table": arrays.add(table),
        "topologies": len(topologies),
        "topology_table": arrays.add(np.array(topologies, dtype=np.int64).reshape(-1, 4)),
        "failed": failed,
        "skinned": _describe_skinning(mesh, arrays),
    }


def _describe_skinning(mesh: MeshAnimation, arrays: ArrayWriter) -> Places | None:
    found = mesh.skinning
    if found is None:
        return None
    rest, joints, weights = map(arrays.add, (found.rest, found.joints, found.weights))
    return rest, joints, weights, *found.joints.shape


def _describe_textures(asset: Asset, prim: str, arrays: ArrayWriter) -> Any:
    try:
        found = texture_coordinates(asset, prim)
    except errors.InputError as error:
        return describe_error(error)
    return None if found is None else [arrays.add(found), len(found)]


def asset_from(report: Mapping[str, Any], source: str, path: Path, owner: object) -> Asset:
    """Return the asset that was described.

    Parameters
    ----------
    report : mapping
        What `describe_asset` said, and the `files` and the `reach` of `IsolatedFacts`.
    source : str
        As it was asked for.
    path : Path
        The file of arrays.
    owner : object
        Lives as long as anything that needs that file.
    """
    told = report["asset"]
    meshes = told["meshes"]
    textures = {
        _checked(str, mesh["prim"]): _textures_from(mesh["textures"], path)
        for mesh in meshes
        if mesh.get("textures") is not None
    }
    return Asset(
        source=source,
        meshes=tuple(_mesh_from(mesh, path, owner) for mesh in meshes),
        facts=IsolatedFacts(
            _checked(Files, report["files"]),
            _checked(tuple[str, ...], report["reach"]),
            path,
            textures,
            owner,
        ),
        **_fields_from(Asset, told),
    )


def _mesh_from(told: Mapping[str, Any], path: Path, owner: object) -> MeshAnimation:
    n_frames, n_topologies = _checked(int, told["frames"]), _checked(int, told["topologies"])
    times = read_floats(path, _checked(int, told["times"]), n_frames)
    frames = IsolatedFrames(
        path=path,
        times=times,
        table=read_integers(path, _checked(int, told["table"]), n_frames, 3),
        topologies=read_integers(path, _checked(int, told["topology_table"]), n_topologies, 4),
        errors={int(index): error_from(error) for index, error in told["failed"].items()},
        skinned=_checked(Places | None, told["skinned"]),
        _owner=owner,
    )
    return MeshAnimation(times=times, source=frames, **_fields_from(MeshAnimation, told))


def _textures_from(told: Any, path: Path) -> tuple[int, int] | MeshmarkError:
    if isinstance(told, dict):
        return error_from(told)
    begin, n_triangles = _checked(tuple[int, ...], told)
    require_within(path, np.array([begin]), np.array([6 * n_triangles]))
    return begin, n_triangles


def _fields_from(kind: type[Any], told: Mapping[str, Any]) -> dict[str, Any]:
    hints = get_type_hints(kind)
    apart = _APART | {"source"}
    return {
        item.name: _checked(hints[item.name], told[item.name])
        for item in fields(kind)
        if item.name not in apart
    }


def _checked(kind: Any, value: Any) -> Any:
    """Return a JSON value as what it was before: text, a number, a tuple, a small record."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return None if value is None else _checked(arguments[0], value)
    if origin is tuple and isinstance(value, list):
        each = arguments[:1] * len(value) if arguments[-1] is ... else arguments
        return tuple(_checked(k, v) for k, v in zip(each, value, strict=True))
    if isinstance(kind, type) and is_dataclass(kind) and isinstance(value, dict):
        return kind(**_fields_from(kind, value))
    if kind is float and type(value) is int:
        return float(value)
    if type(value) is not kind:
        raise TypeError(f"{value!r} is no {kind}")
    return value
