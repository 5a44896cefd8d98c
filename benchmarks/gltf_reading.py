"""Compares reading glTF files with the least that it could take: JSON, and arrays from bytes.

python benchmarks/gltf_reading.py FILE... prints two tables: how many times the least reading takes,
alone and with all frames; and the same of its steps. Each round measures both, one after the other,
in CPU time; ratios are medians over rounds.

The least is: read the file, parse its JSON, decode what is compressed, and make an array of each
accessor of vertices, faces and keys. Reading also checks all of it, and frames are computed.

With MALLOC_TRIM_THRESHOLD_ and MALLOC_MMAP_THRESHOLD_ at 1000000000, glibc keeps its memory.
Otherwise what new pages cost may be most of the least.
"""

from __future__ import annotations

import argparse
import base64
import json
import statistics
import struct
import time
import tracemalloc
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from meshmark_plugins.readers.gltf.container import read_container
from meshmark_plugins.readers.gltf.document import Document
from meshmark_plugins.readers.gltf.reader import GltfReader

TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
STEPS = ("file and JSON", "nodes", "meshes and skins", "clip", "frame rate", "the rest")
MESHOPT = "EXT_meshopt_compression"
DRACO = "KHR_draco_mesh_compression"


def least(path: Path) -> list[Any]:
    """Read a file without any check."""
    data = path.read_bytes()
    if data.startswith(b"glTF"):
        size = struct.unpack_from("<I", data, 12)[0]
        document, buffer = json.loads(data[20 : 20 + size]), data[28 + size :]
    else:
        document = json.loads(data)
        buffer = base64.b64decode(document["buffers"][0]["uri"].partition(",")[2])
    wanted, packed = _wanted(document)
    views: dict[int, Any] = {}
    found = [_draco(document["bufferViews"][view], buffer) for view in packed]
    for index in wanted:
        accessor = document["accessors"][index]
        if "bufferView" in accessor:
            view = accessor["bufferView"]
            if view not in views:
                views[view] = _view(document["bufferViews"][view], buffer)
            found.append(_array(accessor, document["bufferViews"][view], views[view]))
    return found


def _wanted(document: dict[str, Any]) -> tuple[list[int], list[int]]:
    """List the accessors that a reader of the first clip needs, and the views of Draco."""
    wanted: dict[int, None] = {}
    packed = []
    for mesh in document["meshes"]:
        for primitive in mesh["primitives"]:
            draco = primitive.get("extensions", {}).get(DRACO)
            packed += [draco["bufferView"]] if draco else []
            used = {
                k: v
                for k, v in primitive["attributes"].items()
                if k in ("POSITION", "JOINTS_0", "WEIGHTS_0")
            }
            targets = [target["POSITION"] for target in primitive.get("targets", ())]
            indices = [primitive["indices"]] if "indices" in primitive else []
            wanted |= dict.fromkeys([*used.values(), *targets, *indices])
    for skin in document.get("skins", ()):
        wanted[skin["inverseBindMatrices"]] = None
    for number, clip in enumerate(document.get("animations", ())):
        for sampler in clip["samplers"]:
            # The rate of frames is that of all clips.
            wanted |= dict.fromkeys([sampler["input"], *([] if number else [sampler["output"]])])
    return list(wanted), packed


def _view(view: dict[str, Any], buffer: bytes) -> Any:
    packed = view.get("extensions", {}).get(MESHOPT)
    where = packed or view
    begin = where.get("byteOffset", 0)
    data = buffer[begin : begin + where["byteLength"]]
    if packed is None:
        return data
    import meshopt

    return (
        meshopt.decode_gltf_buffer(
            data,
            packed["count"],
            packed["byteStride"],
            packed["mode"],
            packed.get("filter", "NONE"),
        )
        .reshape(-1)
        .view("u1")
    )


def _draco(view: dict[str, Any], buffer: bytes) -> Any:
    import DracoPy

    begin = view.get("byteOffset", 0)
    return DracoPy.decode(buffer[begin : begin + view["byteLength"]])


def _array(accessor: dict[str, Any], view: dict[str, Any], data: Any) -> Any:
    dtype, width = np.dtype(TYPES[accessor["componentType"]]), WIDTHS[accessor["type"]]
    begin, count = accessor.get("byteOffset", 0), accessor["count"]
    stride = view.get("byteStride", width * dtype.itemsize)
    if stride == width * dtype.itemsize:
        return np.frombuffer(data, dtype, count * width, begin).reshape(count, width)
    return np.ndarray((count, width), dtype, data, begin, (stride, dtype.itemsize))


def ratios(path: Path, rounds: int) -> tuple[float, float]:
    """Return how many times the least reading takes, and reading with all frames."""
    reader = GltfReader()
    alone, with_frames = [], []
    for _ in range(rounds):
        lowest = _cpu(lambda: least(path))
        alone.append(_cpu(lambda: reader.read(str(path))) / lowest)
        with_frames.append(_cpu(lambda: _frames(reader, path), 1) / lowest)
    return statistics.median(alone), statistics.median(with_frames)


def _frames(reader: GltfReader, path: Path) -> None:
    for mesh in reader.read(str(path)).meshes:
        for _ in mesh:
            pass


def steps(path: Path, rounds: int) -> dict[str, float]:
    """Return how many times the least each step of reading takes."""
    reader = GltfReader()
    taken: dict[str, list[float]] = {}
    for _ in range(rounds):
        lowest, whole = _cpu(lambda: least(path)), _cpu(lambda: reader.read(str(path)))
        clock = [time.process_time()]
        container = read_container(path)
        clock.append(time.process_time())
        document = Document(container, path.parent)
        clock.append(time.process_time())
        meshes, _ = document.meshes()
        clock.append(time.process_time())
        document.clip("", meshes)
        clock.append(time.process_time())
        document.densest_rate()
        clock.append(time.process_time())
        each = [end - begin for begin, end in pairwise(clock)]
        for name, value in zip(STEPS, [*each, whole - sum(each)], strict=True):
            taken.setdefault(name, []).append(value / lowest)
    return {name: statistics.median(values) for name, values in taken.items()}


def _cpu(call: Callable[[], object], times: int = 5) -> float:
    begin = time.process_time()
    for _ in range(times):
        call()
    return (time.process_time() - begin) / times


def memory(path: Path, frames: int) -> float:
    """Return the most megabytes in use while so many frames are asked for, one by one."""
    reader = GltfReader()
    tracemalloc.start()
    for mesh in reader.read(str(path)).meshes:
        for index in range(frames):
            mesh[index % len(mesh)]
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--rounds", type=int, default=21)
    wanted = parser.parse_args()
    print("| file | reading | and all frames | MB, 1 frame | MB, all frames |")
    print("|---|---|---|---|---|")
    for path in wanted.files:
        alone, with_frames = ratios(path, wanted.rounds)
        n = max(map(len, GltfReader().read(str(path)).meshes))
        few, all_of_them = memory(path, 1), memory(path, n)
        print(
            f"| `{path.name}` | {alone:.1f} | {with_frames:.0f} | {few:.1f} "
            f"| {all_of_them:.1f} ({n}) |"
        )
    print()
    print(f"| file | {' | '.join(STEPS)} |")
    print(f"|---|{'---|' * len(STEPS)}")
    for path in wanted.files:
        values = steps(path, 5 * wanted.rounds).values()
        print(f"| `{path.name}` | {' | '.join(f'{value:.2f}' for value in values)} |")


if __name__ == "__main__":
    main()
