"""Small glTF files for the tests of their reader, built without it."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from meshmark.testing.meshes import icosphere

TYPES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}

QUAD = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype="f4")
QUAD_FACES = [[0, 1, 2], [0, 2, 3]]
QUARTER = [0, 0, np.sqrt(0.5), np.sqrt(0.5)]  # turn about z


class GltfFile:
    """A glTF document that is put together, and its binary data."""

    def __init__(self, **members: Any) -> None:
        self.json: dict[str, Any] = {"asset": {"version": "2.0"}, **members}
        self.data = bytearray()

    def add(self, kind: str, **members: Any) -> int:
        """Add an object to one of the document's lists, and return its index."""
        self.json.setdefault(kind, []).append(members)
        return len(self.json[kind]) - 1

    def view(self, data: bytes, **members: Any) -> int:
        """Add bytes, and a view of them."""
        self.data += b"\0" * (-len(self.data) % 4)
        begin = len(self.data)
        self.data += data
        return self.add("bufferViews", buffer=0, byteOffset=begin, byteLength=len(data), **members)

    def accessor(self, values: ArrayLike, dtype: str = "f4", **members: Any) -> int:
        """Add an array, and an accessor of it."""
        array = np.asarray(values, dtype=f"<{dtype}")
        rows = array.reshape(len(array), -1)
        described = self.describe(rows, dtype)
        return self.add("accessors", bufferView=self.view(rows.tobytes()), **described, **members)

    def describe(self, rows: NDArray[Any], dtype: str = "f4") -> dict[str, Any]:
        """Spell what an accessor says of an array (N, width)."""
        return {
            "componentType": TYPES[dtype],
            "count": len(rows),
            "type": KINDS[rows.shape[1]],
        }

    def primitive(self, points: ArrayLike, faces: ArrayLike | None, **attributes: int) -> dict:
        """Describe a primitive of new points, and of faces if they are given."""
        found: dict[str, Any] = {"attributes": {"POSITION": self.accessor(points), **attributes}}
        if faces is not None:
            found["indices"] = self.accessor(np.reshape(faces, -1), "u2")
        return found

    def mesh(self, *primitives: dict, **members: Any) -> int:
        """Add a mesh."""
        return self.add("meshes", primitives=list(primitives), **members)

    def animate(self, node: int, path: str, times: ArrayLike, values: ArrayLike, **sampler: Any):
        """Add a channel to the last clip; the first makes one."""
        clips = self.json.setdefault("animations", [{"channels": [], "samplers": []}])
        # Weights are listed one by one.
        listed = np.reshape(values, (-1, 1)) if path == "weights" else values
        made = {"input": self.accessor(times), "output": self.accessor(listed), **sampler}
        clips[-1]["samplers"].append(made)
        number = len(clips[-1]["samplers"]) - 1
        clips[-1]["channels"].append({"sampler": number, "target": {"node": node, "path": path}})

    def binary(self) -> bytes:
        """Return the file in its binary form."""
        described = {"buffers": [{"byteLength": len(self.data)}], **self.json}
        return glb((b"JSON", json.dumps(described).encode()), (b"BIN\0", bytes(self.data)))

    def save(self, path: Path) -> str:
        """Write a .glb; or a .gltf with its data in it."""
        if path.suffix.lower() == ".glb":
            path.write_bytes(self.binary())
        else:
            data = base64.b64encode(bytes(self.data)).decode()
            uri = f"data:application/octet-stream;base64,{data}"
            self.save_with_buffer(path, uri)
        return str(path)

    def save_with_buffer(self, path: Path, uri: str) -> str:
        """Write a .gltf that names its buffer."""
        described = {**self.json, "buffers": [{"byteLength": len(self.data), "uri": uri}]}
        path.write_text(json.dumps(described), "utf-8")
        return str(path)


def glb(*chunks: tuple[bytes, bytes], magic: bytes = b"glTF", version: int = 2) -> bytes:
    """Put chunks of a kind and data into the binary form."""
    body = b""
    for kind, data in chunks:
        padded = data + (b" " if kind == b"JSON" else b"\0") * (-len(data) % 4)
        body += struct.pack("<I4s", len(padded), kind) + padded
    return struct.pack("<4sII", magic, version, 12 + len(body)) + body


def quad() -> GltfFile:
    """Build a single node of a single quad."""
    made = GltfFile()
    made.add("nodes", mesh=made.mesh(made.primitive(QUAD, QUAD_FACES)), name="quad")
    return made


def ball(subdivisions: int = 1, *, bending: bool = True) -> GltfFile:
    """Build a ball that is morphed, skinned by two joints, and moves, 9 keys at 12 a second.

    Without bending, its frames are the same but for where they are.
    """
    made = GltfFile()
    V, F = icosphere(subdivisions)
    n = len(V)
    upper = np.clip(0.5 + 0.5 * V[:, 2], 0, 1)
    joints = made.accessor(np.tile([0, 1, 0, 0], (n, 1)), "u1")
    weights = made.accessor(np.stack([1 - upper, upper, 0 * upper, 0 * upper], axis=1))
    primitive = made.primitive(V, F, JOINTS_0=joints, WEIGHTS_0=weights)
    primitive["targets"] = [{"POSITION": made.accessor(0.2 * V * [1, 0, 0])}]
    mesh = made.mesh(primitive, weights=[0.5], name="ball")
    made.add("nodes", children=[1, 2], name="root")
    made.add("nodes", children=[3], name="lower")
    skin = made.add(
        "skins",
        joints=[1, 3],
        inverseBindMatrices=made.accessor(np.tile(np.eye(4).reshape(-1), (2, 1))),
    )
    made.add("nodes", mesh=mesh, skin=skin, name="ball")
    made.add("nodes", name="upper")
    times = np.arange(9) / 12
    half = np.linspace(0, 0.4, 9)
    turns = np.stack([np.sin(half), 0 * half, 0 * half, np.cos(half)], axis=1)
    if bending:
        made.animate(3, "rotation", times, turns)
        made.animate(2, "weights", times, np.linspace(0, 1, 9))
    made.animate(1, "translation", times, np.outer(times, [1, 0, 0]))
    return made


def skinned_quad(
    weights: ArrayLike, dtype: str = "f4", joints: ArrayLike = ((0, 1, 0, 0),) * 4, **members: Any
) -> GltfFile:
    """Bind a square to two joints, the second turned a quarter about z."""
    made = GltfFile()
    primitive = made.primitive(QUAD, QUAD_FACES)
    primitive["attributes"]["JOINTS_0"] = made.accessor(joints, "u2")
    primitive["attributes"]["WEIGHTS_0"] = made.accessor(weights, dtype, **members)
    made.add("nodes", mesh=made.mesh(primitive), skin=0, translation=[100, 0, 0])
    made.add("nodes", translation=[1, 0, 0])
    made.add("nodes", translation=[0, 5, 0], children=[3])
    made.add("nodes", rotation=QUARTER)
    away = np.eye(4)
    away[:3, 3] = [-1, 0, 0]
    matrices = made.accessor([away.T.reshape(-1), np.eye(4).reshape(-1)])
    made.add("skins", joints=[1, 3], inverseBindMatrices=matrices)
    return made


def draco_quad() -> GltfFile:
    """Compress a quad by Draco, where that is installed."""
    draco = pytest.importorskip("DracoPy", reason="DracoPy, an optional library, is absent")
    made = quad()
    primitive = made.json["meshes"][0]["primitives"][0]
    packed = draco.encode(QUAD, faces=np.array(QUAD_FACES), preserve_order=True)
    [number] = [each["unique_id"] for each in draco.decode(packed).attributes]
    extension = {"bufferView": made.view(packed), "attributes": {"POSITION": number}}
    primitive["extensions"] = {"KHR_draco_mesh_compression": extension}
    made.json["extensionsUsed"] = ["KHR_draco_mesh_compression"]
    for accessor in made.json["accessors"]:
        del accessor["bufferView"]
    return made
