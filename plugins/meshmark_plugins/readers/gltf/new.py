"""Writes any asset as a new glTF file: the points of each frame as a morph target."""

from __future__ import annotations

import math
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any
from urllib.parse import quote

import numpy as np
from numpy.typing import ArrayLike

from meshmark.errors import OutputError, UsageError
from meshmark.files.atomic import beside
from meshmark.files.places import data_file
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.precision import stored
from meshmark_plugins.readers.gltf.container import (
    BINARY,
    BINARY_SUFFIX,
    CHUNK_HEADER,
    HEADER,
    JSON,
    LARGEST_BINARY,
    MAGIC,
    VERSION,
    spelled,
)
from meshmark_plugins.readers.gltf.element import Element
from meshmark_plugins.readers.gltf.nodes import read_nodes
from meshmark_plugins.readers.gltf.timeline import CODES, RATE

FLOAT, UNSIGNED = 5126, 5125
VERTICES, INDICES = 34962, 34963
NAMELESS = "Mesh"
BYTES = 4  # of a number
ROOM = 1 << 28  # bytes, for faces and the document


def write_new(asset: Asset, output: Path) -> None:
    """Write the meshes of an asset, as they are in every frame, and nothing else.

    The first frame of a mesh is its positions; each other frame is a morph target, and its weight
    is 1 at that frame and 0 at all others. Between frames, points move straight. Polygons become
    triangles. Coordinates stay as they are, whatever their unit and upward axis.

    Parameters
    ----------
    asset : Asset
        Frames are asked for one at a time.
    output : Path
        A .glb; or a .gltf, whose buffer is put beside it.

    Raises
    ------
    UsageError
        If faces of a mesh change over time.
    OutputError
        If it cannot be written, or would be larger than the format allows; if a point is not
        finite, or beyond what float32 holds.
    """
    _require_small(asset, output)
    with beside(output) as place:
        parts = place.with_name("data")
        with parts.open("xb") as file:
            document = _document(asset, _Arrays(file))
            length = file.tell()
        if output.suffix.lower() == BINARY_SUFFIX:
            _put_together(place, document, parts, length)
        else:
            path = data_file(output, 0)
            document["buffers"][0]["uri"] = quote(path.name)
            place.write_bytes(spelled(document))
            parts.replace(path)
        place.replace(output)


def written_paths(asset: Asset) -> dict[str, str]:
    """Map the name of each mesh of an asset to its path in what `write_new` makes of it."""
    nodes, mesh_nodes = _nodes([mesh.prim for mesh in asset.meshes])
    meshes: list[dict[str, Any]] = [{}] * len(asset.meshes)
    paths = read_nodes(Element({"nodes": nodes, "meshes": meshes})).paths(mesh_nodes)
    return {mesh.prim: paths[node] for mesh, node in zip(asset.meshes, mesh_nodes, strict=True)}


class _Arrays:
    """Accessors and views of arrays that are written one after the other."""

    def __init__(self, file: IO[bytes]) -> None:
        self.accessors: list[dict[str, Any]] = []
        self.views: list[dict[str, Any]] = []
        self._file = file

    def add(self, values: ArrayLike, kind: str, target: int | None = None) -> int:
        """Write an array, and return the number of its accessor."""
        array = np.asarray(values)
        rows = array.reshape(len(array), -1)
        view = {"buffer": 0, "byteOffset": self._file.tell(), "byteLength": rows.nbytes}
        self.views.append(view if target is None else view | {"target": target})
        self.accessors.append(
            {
                "bufferView": len(self.views) - 1,
                "componentType": FLOAT if array.dtype.kind == "f" else UNSIGNED,
                "count": len(rows),
                "type": kind,
                "min": rows.min(axis=0).tolist(),
                "max": rows.max(axis=0).tolist(),
            }
        )
        self._file.write(rows.tobytes())
        return len(self.accessors) - 1


def _require_small(asset: Asset, output: Path) -> None:
    """Refuse what cannot be counted by a binary file, before any frame is asked for."""
    size = sum(
        BYTES * len(mesh) * (3 * mesh[0].topology.n_points + len(mesh)) for mesh in asset.meshes
    )
    if size > LARGEST_BINARY - ROOM:
        raise OutputError(f"would have {size / 1e9:.0f} GB; glTF holds 4 GB", source=output)


def _document(asset: Asset, arrays: _Arrays) -> dict[str, Any]:
    nodes, mesh_nodes = _nodes([mesh.prim for mesh in asset.meshes])
    samplers: list[dict[str, Any]] = []
    channels: list[dict[str, Any]] = []
    meshes = []
    for mesh, node in zip(asset.meshes, mesh_nodes, strict=True):
        meshes.append(_mesh(mesh, asset.fps, arrays))
        if len(mesh) > 1:
            channels.append({"sampler": len(samplers), "target": {"node": node, "path": "weights"}})
            samplers.append(_sampler(mesh, asset.fps, arrays))
    children = {child for node in nodes for child in node.get("children", ())}
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [i for i in range(len(nodes)) if i not in children]}],
        "nodes": nodes,
        "meshes": meshes,
        "accessors": arrays.accessors,
        "bufferViews": arrays.views,
        "buffers": [{"byteLength": sum(view["byteLength"] for view in arrays.views)}],
    }
    return document | (
        {"animations": [{"samplers": samplers, "channels": channels}]} if samplers else {}
    )


def _nodes(prims: Sequence[str]) -> tuple[list[dict[str, Any]], list[int]]:
    """Make a node for each part of the paths of meshes; return them, and which have meshes."""
    nodes: list[dict[str, Any]] = []
    known: dict[tuple[str, ...], int] = {}
    for mesh, prim in enumerate(prims):
        parts = tuple(part for part in prim.split("/") if part) or (NAMELESS,)
        for end in range(1, len(parts) + 1):
            path = parts[:end]
            if path in known:
                continue
            known[path] = len(nodes)
            nodes.append({"name": path[-1]})
            if end > 1:
                nodes[known[path[:-1]]].setdefault("children", []).append(known[path])
        nodes[known[parts]]["mesh"] = mesh
    holders = {node["mesh"]: index for index, node in enumerate(nodes) if "mesh" in node}
    return nodes, [holders[mesh] for mesh in range(len(prims))]


def _mesh(mesh: MeshAnimation, fps: float, arrays: _Arrays) -> dict[str, Any]:
    """Write the points of all frames, and the triangles."""
    if not mesh.constant_topology:
        raise UsageError("its faces change over time, which glTF cannot", prim=mesh.prim)
    primitive: dict[str, Any] = {}
    base = np.zeros((0, 3))
    for frame in mesh:
        where = {"source": mesh.origin, "prim": mesh.prim, "time": frame.time}
        if primitive:
            displacements = stored(frame.points - base, "<f4", **where)
            target = {"POSITION": arrays.add(displacements, "VEC3", VERTICES)}
            primitive.setdefault("targets", []).append(target)
            continue
        points = stored(frame.points, "<f4", **where)
        base = points.astype(np.float64)
        primitive["attributes"] = {"POSITION": arrays.add(points, "VEC3", VERTICES)}
        corners = frame.faces.astype("<u4").reshape(-1)
        primitive["indices"] = arrays.add(corners, "SCALAR", INDICES)
    # Which time codes the keys are at, so that they are read back whatever their rate.
    told = {RATE: fps, CODES: mesh.times.tolist()}
    return {"primitives": [primitive]} | ({"extras": told} if len(mesh) > 1 else {})


def _sampler(mesh: MeshAnimation, fps: float, arrays: _Arrays) -> dict[str, Any]:
    """Write when which frame shows."""
    times = (mesh.times - min(0.0, math.floor(mesh.times[0]))) / fps
    weights = np.eye(len(times), dtype="<f4")[:, 1:].reshape(-1)
    return {
        "input": arrays.add(times.astype("<f4"), "SCALAR"),
        "output": arrays.add(weights, "SCALAR"),
        "interpolation": "LINEAR",
    }


def _put_together(place: Path, document: dict[str, Any], data: Path, length: int) -> None:
    """Write the binary form, with a chunk that is copied from a file."""
    text = spelled(document)
    text += b" " * (-len(text) % 4)
    whole = HEADER.size + 2 * CHUNK_HEADER.size + len(text) + length
    with place.open("xb") as file, data.open("rb") as chunk:
        file.write(HEADER.pack(MAGIC, VERSION, whole))
        file.write(CHUNK_HEADER.pack(len(text), JSON) + text)
        file.write(CHUNK_HEADER.pack(length, BINARY))
        shutil.copyfileobj(chunk, file)
