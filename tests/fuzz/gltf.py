"""Small glTF files of every form; alters values of their documents, and bytes."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from random import Random
from typing import Any

from .archives import altered_json
from .texts import altered_bytes, altered_text, words_of

Path = tuple[Any, ...]

HEADER = struct.Struct("<4sIIII")
COUNTS = (-1, 0, 1, 2, 3, 5, 7, 255, 256, 65535, 65536, 1 << 24, 1 << 31, 1 << 32, 1 << 40, 1 << 63)
KINDS = words_of(
    "SCALAR VEC2 VEC3 VEC4 MAT2 MAT3 MAT4 LINEAR STEP CUBICSPLINE translation rotation scale"
)
KINDS += words_of(
    "weights ATTRIBUTES TRIANGLES INDICES NONE EXPONENTIAL OCTAHEDRAL QUATERNION COLOR"
)
COMPONENTS = (5120, 5121, 5122, 5123, 5124, 5125, 5126, 5130)
URIS = [
    "x.bin",
    "../outside/kept",
    "/etc/passwd",
    "data:,",
    "data:;base64,AAAA",
    "%2e%2e/k",
    "k",
    "",
]
WORDS = [*words_of('nan 1e999 -0 0 null true [] {} "" [[]] 4294967296'), b'"\\ud800"', b"[" * 500]
NAMES = words_of(
    "sparse matrix skin mesh children extensions byteStride byteOffset bufferView mode uri extras"
)


def altered_gltf(data: bytes, rng: Random) -> bytes:
    """Alter a file of either form, or a buffer: values mostly, and bytes."""
    binary = data.startswith(b"glTF")
    if not (binary or data.startswith(b"{")) or rng.random() < 0.1:
        return altered_bytes(data, rng)
    size = HEADER.unpack_from(data)[3] if binary else len(data)
    begin = HEADER.size if binary else 0
    text, rest = data[begin : begin + size], data[begin + size :]
    if binary and rng.random() < 0.25:
        rest = rest[:8] + altered_bytes(rest[8:], rng)
        if rng.random() < 0.3:
            rest = altered_bytes(rest, rng)
    elif rng.random() < 0.1:
        text = altered_text(text, rng, WORDS)
    else:
        document = json.loads(text)
        for _ in range(rng.choice((1, 1, 1, 1, 2, 3))):
            document = rng.choice(STEPS)(document, rng)
            if not isinstance(document, dict):
                break
        text = json.dumps(document).encode("utf-8", "surrogatepass")
    if not binary:
        return text
    text += b" " * (-len(text) % 4)
    length = HEADER.size + len(text) + len(rest)
    if rng.random() < 0.03:
        length = rng.choice(COUNTS) % (1 << 32)
    return HEADER.pack(b"glTF", 2, length, len(text), 0x4E4F534A) + text + rest


def _number(document: Any, rng: Random) -> Any:
    """Change one number: by a little, or into one that is out of place."""
    found = [path for path, value in _leaves(document) if type(value) in (int, float)]
    if not found:
        return document
    path = rng.choice(found)
    value = _at(document, path)
    if path[-1] == "componentType" and rng.random() < 0.7:
        return _with(document, path, rng.choice(COMPONENTS))
    near = value + rng.choice((-4, -1, 1, 2, 4, 12, 1000))
    odd = rng.choice((*COUNTS, 0.5, 1e300, -1e-300, 3.5e38))
    return _with(document, path, near if rng.random() < 0.5 else odd)


def _word(document: Any, rng: Random) -> Any:
    """Exchange a text for another."""
    found = [path for path, value in _leaves(document) if isinstance(value, str)]
    if not found:
        return document
    path = rng.choice(found)
    if path[-1] == "uri":
        return _with(document, path, rng.choice(URIS))
    return _with(document, path, rng.choice(KINDS).decode())


def _link(document: Any, rng: Random) -> Any:
    """Let nodes hang from each other, or from themselves."""
    nodes = document.get("nodes")
    if not isinstance(nodes, list) or not nodes:
        return document
    at, other = rng.randrange(len(nodes)), rng.randrange(len(nodes))
    members = nodes[at] if isinstance(nodes[at], dict) else {}
    children = members.get("children", [])
    more = [*(children if isinstance(children, list) else []), other]
    return _with(document, ("nodes", at), {**members, "children": more})


def _member(document: Any, rng: Random) -> Any:
    """Give an object a member of another one, or take one from it."""
    found = [(), *(path for path, value in _all(document) if isinstance(value, dict))]
    path, source = rng.choice(found), _at(document, rng.choice(found))
    target = dict(_at(document, path))
    if rng.random() < 0.5 and target:
        del target[rng.choice(list(target))]
    elif source:
        name = rng.choice(list(source))
        target[name if rng.random() < 0.7 else rng.choice(NAMES).decode()] = source[name]
    return _with(document, path, target)


STEPS = (_number, _number, _number, _number, _word, _link, _member, _member, altered_json)


def _all(value: Any, path: Path = ()) -> Iterator[tuple[Path, Any]]:
    waiting = [(path, value)]
    while waiting:
        path, value = waiting.pop()
        yield path, value
        if isinstance(value, dict):
            waiting += [((*path, name), each) for name, each in value.items()]
        elif isinstance(value, list):
            waiting += [((*path, i), each) for i, each in enumerate(value)]


def _leaves(document: Any) -> list[tuple[Path, Any]]:
    return [(path, value) for path, value in _all(document) if not isinstance(value, dict | list)]


def _at(value: Any, path: Path) -> Any:
    for step in path:
        value = value[step]
    return value


def _with(value: Any, path: Path, new: Any) -> Any:
    """Return a copy of a document with another value at a place."""
    if not path:
        return new
    copy = dict(value) if isinstance(value, dict) else list(value)
    copy[path[0]] = _with(value[path[0]], path[1:], new)
    return copy


def files(folder: Any) -> dict[str, dict[str, bytes]]:
    """Make small files: a body that is skinned, morphed and moves, in every form there is."""
    from gltf_files import GltfFile, draco_quad

    from .seeds import horned

    V, F = horned()

    def body() -> GltfFile:
        return _body(GltfFile(), V, F)

    made = {name: body() for name in ("plain", "sparse", "quantised", "packed")}
    _make_sparse(made["sparse"], V)
    _quantise(made["quantised"], V)
    _pack(made["packed"])
    found = {name: {f"{name}.glb": each.binary()} for name, each in made.items()}
    found["draco"] = {"draco.glb": draco_quad().binary()}
    text = body()
    text.save(folder / "text.gltf")
    found["text"] = {"text.gltf": (folder / "text.gltf").read_bytes()}
    beside = body()
    beside.json["images"] = [{"uri": "skin.png"}]
    beside.save_with_buffer(folder / "beside.gltf", "data.bin")
    found["beside"] = {
        "beside.gltf": (folder / "beside.gltf").read_bytes(),
        "data.bin": bytes(beside.data),
        "skin.png": b"",
    }
    return found


def _body(made: Any, V: Any, F: Any) -> Any:
    import numpy as np

    n = len(V)
    weights = np.clip(0.5 + 0.5 * V[:, :1], 0, 1)
    joints = made.accessor(np.tile([0, 1, 0, 0], (n, 1)), "u1")
    shares = made.accessor(np.hstack([1 - weights, weights, 0 * weights, 0 * weights]))
    primitive = made.primitive(V, F, JOINTS_0=joints, WEIGHTS_0=shares)
    primitive["targets"] = [{"POSITION": made.accessor(0.1 * V * [0, 0, 1])}]
    mesh = made.mesh(primitive, weights=[0.0])
    made.add("nodes", children=[1, 2], name="root")
    made.add("nodes", name="lower", children=[3])
    inverse = made.accessor(np.tile(np.eye(4).reshape(-1), (2, 1)))
    made.add("nodes", mesh=mesh, skin=made.add("skins", joints=[1, 3], inverseBindMatrices=inverse))
    made.add("nodes", rotation=[0.0, 0.0, 0.0, 1.0])
    times = np.arange(3) / 12
    made.animate(2, "weights", times, np.arange(3.0))
    made.animate(1, "translation", times, np.outer(times, [1, 0, 0]), interpolation="STEP")
    spline = np.zeros((9, 4))
    spline[1::3, 3] = 1
    made.animate(3, "rotation", times, spline, interpolation="CUBICSPLINE")
    made.add("scenes", nodes=[0])
    return made


def _position(made: Any) -> dict[str, Any]:
    return made.json["accessors"][made.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"]]


def _make_sparse(made: Any, V: Any) -> None:
    import numpy as np

    listed = np.arange(0, len(V), 3)
    _position(made)["sparse"] = {
        "count": len(listed),
        "indices": {"bufferView": made.view(listed.astype("<u2").tobytes()), "componentType": 5123},
        "values": {"bufferView": made.view(V[listed].astype("<f4").tobytes())},
    }


def _quantise(made: Any, V: Any) -> None:
    import numpy as np

    rows = np.zeros((len(V), 4), "<i2")
    rows[:, :3] = np.rint(V * 10000)
    view = made.view(rows.tobytes(), byteStride=8)
    _position(made).update(bufferView=view, componentType=5122, normalized=True)
    made.json["extensionsUsed"] = ["KHR_mesh_quantization"]


def _pack(made: Any) -> None:
    """Compress positions and faces by meshoptimizer."""
    import meshopt
    import numpy as np

    primitive = made.json["meshes"][0]["primitives"][0]
    for index, mode in (
        (primitive["attributes"]["POSITION"], "ATTRIBUTES"),
        (primitive["indices"], "INDICES"),
    ):
        accessor = made.json["accessors"][index]
        view = made.json["bufferViews"][accessor["bufferView"]]
        begin, length = view["byteOffset"], view["byteLength"]
        data = np.frombuffer(bytes(made.data[begin : begin + length]), np.uint8)
        rows = data.reshape(accessor["count"], -1)
        values = rows if mode == "ATTRIBUTES" else rows.view("<u2")[:, 0]
        made.view(meshopt.encode_gltf_buffer(values, mode))
        told = {"count": len(rows), "byteStride": rows.shape[1], "mode": mode}
        view["extensions"] = {"EXT_meshopt_compression": {**made.json["bufferViews"].pop(), **told}}
        view["buffer"] = 1
    fallback = {"byteLength": 10**5, "extensions": {"EXT_meshopt_compression": {"fallback": True}}}
    made.json["buffers"] = [{"byteLength": len(made.data)}, fallback]
    made.json["extensionsUsed"] = ["EXT_meshopt_compression"]
