"""glTF files made to crash, fill or mislead their reader: one line each, in little memory."""

from __future__ import annotations

import copy
import json
import os
import re
import sys
import tracemalloc
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gltf_files import QUAD, GltfFile, ball, glb, quad
from meshmark.cli import main
from meshmark.errors import InputError
from meshmark_plugins.readers.gltf.reader import GltfReader

MOST_MEMORY = 50e6  # bytes, far above what small files need
HUGE = 10**10
NASTY = [-1, 1.5, 1e300, 10**30, HUGE, True, None, "", "x", [], {}, [[]], [-1], [{}], ["x"]]


def text(made: GltfFile) -> bytes:
    return json.dumps(made.json).encode()


def with_json(data: bytes) -> bytes:
    return glb((b"JSON", data))


def changed(made: GltfFile, *path: Any, value: Any) -> bytes:
    """Return a file of which one value is another."""
    place = made.json
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    return made.binary()


def primitive(made: GltfFile) -> dict[str, Any]:
    return made.json["meshes"][0]["primitives"][0]


def sparse_claim() -> bytes:
    made = quad()
    view = made.view(bytes(4))
    sparse = {
        "count": 1,
        "indices": {"bufferView": view, "componentType": 5123},
        "values": {"bufferView": 0},
    }
    accessor = made.json["accessors"][0]
    del accessor["bufferView"]
    accessor.update(count=HUGE // 12, sparse=sparse)
    return made.binary()


def meshopt_claim(mode: str, stride: int) -> bytes:
    made = quad()
    length = HUGE // stride * stride
    packed = {"buffer": 0, "byteLength": 40, "count": length // stride, "byteStride": stride}
    extension = {"EXT_meshopt_compression": {**packed, "mode": mode}}
    number = primitive(made)["indices"] if mode != "ATTRIBUTES" else 0
    made.json["bufferViews"][number].update(byteLength=length, extensions=extension)
    made.json["accessors"][number]["count"] = 3 * (HUGE // 3 // stride)
    return made.binary()


def draco_claim(method: int) -> bytes:
    made = quad()
    # Ten billion faces, as a number of seven bits a byte.
    faces = b"\x80\xc8\xaf\xa0\x25"
    traversal = b"" if method == 0 else b"\0"
    header = b"DRACO\2\2\1" + bytes([method]) + b"\0\0" + traversal + faces + b"\4"
    extension = {"bufferView": made.view(header + bytes(900)), "attributes": {"POSITION": 0}}
    primitive(made)["extensions"] = {"KHR_draco_mesh_compression": extension}
    return made.binary()


def chain(depth: int) -> bytes:
    made = quad()
    for _ in range(depth):
        made.add("nodes", children=[len(made.json["nodes"]) - 1])
    return made.binary()


def with_buffer(uri: str) -> bytes:
    made = quad()
    described = {**made.json, "buffers": [{"byteLength": len(made.data), "uri": uri}]}
    return with_json(json.dumps(described).encode())


def endless_clip() -> bytes:
    made = quad()
    made.animate(0, "translation", [0, 1 / 24, 1e9], np.zeros((3, 3)))
    return made.binary()


def nan_weights() -> bytes:
    made = ball()
    weights = np.frombuffer(made.data, "<f4").copy()
    at = made.json["bufferViews"][primitive(made)["attributes"]["WEIGHTS_0"]]["byteOffset"] // 4
    weights[at + 7] = np.nan
    made.data[:] = weights.tobytes()
    return made.binary()


def nan_key() -> bytes:
    made = quad()
    made.add("nodes", children=[0])
    values = np.zeros((3, 3))
    made.animate(0, "translation", [0, 1, 2], values)
    values[2, 1] = np.inf
    made.animate(1, "translation", [0, 1, 2], values)
    return made.binary()


WHOLE = quad().binary()
FILES = {
    "empty": (b"", "does not begin with 'glTF'"),
    "magic": (b"glTX" + WHOLE[4:], "does not begin with 'glTF'"),
    "version": (glb((b"JSON", b"{}"), version=1), "is binary glTF of version 1"),
    "asset version": (with_json(b'{"asset": {"version": "1.0"}}'), "asset.version is '1.0'"),
    "header": (WHOLE[:10], "ends within its header"),
    "cut": (WHOLE[:-1], "is cut short"),
    "chunk": (WHOLE[:16] + b"\xff\xff\xff\xff" + WHOLE[20:], "is cut short|is not JSON"),
    "chunk length": (WHOLE[:12] + b"\xff\xff\xff\x7f" + WHOLE[16:], "reaches beyond the end"),
    "no JSON": (glb((b"BIN\0", b"abcd")), "first chunk is not JSON"),
    "no chunk": (glb(), "holds no chunk of JSON"),
    "two JSON": (glb((b"JSON", b"{}"), (b"JSON", b"{}")), "a second time"),
    "two BIN": (glb((b"JSON", b"{}"), (b"BIN\0", b""), (b"BIN\0", b"")), "a second time"),
    "not UTF-8": (with_json(b'{"asset": "\xff"}'), "not UTF-8 at byte 11"),
    "not JSON": (with_json(b"{"), "JSON is wrong in line 1"),
    "NaN": (with_json(b'{"asset": NaN}'), "NaN is not a number of JSON"),
    "digits": (with_json(b'{"asset": ' + b"9" * 5000 + b"}"), "JSON is wrong"),
    "deep JSON": (with_json(b"[" * 100_000), "nested too deeply"),
    "a list": (with_json(b"[]"), "is not an object"),
    "no mesh": (with_json(b'{"asset": {"version": "2.0"}}'), "holds no mesh"),
    "buffer length": (
        changed(quad(), "buffers", value=[{"byteLength": HUGE}]),
        rf"buffers\[0\].byteLength is {HUGE}, but there are",
    ),
    "view length": (
        changed(quad(), "bufferViews", 0, "byteLength", value=HUGE),
        r"bufferViews\[0\].byteLength",
    ),
    "view offset": (
        changed(quad(), "bufferViews", 0, "byteOffset", value=HUGE),
        r"bufferViews\[0\].byteLength is 48 from",
    ),
    "accessor count": (
        changed(quad(), "accessors", 0, "count", value=HUGE),
        r"accessors\[0\]: ends at byte",
    ),
    "accessor offset": (
        changed(quad(), "accessors", 0, "byteOffset", value=HUGE),
        r"accessors\[0\]: ends at byte",
    ),
    "accessor without view": (
        changed(
            quad(), "accessors", 0, value={"count": HUGE, "componentType": 5126, "type": "VEC3"}
        ),
        r"accessors\[0\].bufferView is missing",
    ),
    "stride": (
        changed(quad(), "bufferViews", 0, "byteStride", value=4),
        r"12 bytes, 4 bytes apart",
    ),
    "sparse claim": (sparse_claim(), r"accessors\[0\].bufferView is missing"),
    "meshopt claim": (meshopt_claim("ATTRIBUTES", 4), "compressed bytes can hold"),
    "meshopt triangles": (meshopt_claim("TRIANGLES", 2), "compressed bytes can hold"),
    "meshopt indices": (meshopt_claim("INDICES", 4), "compressed bytes can hold"),
    "draco claim": (draco_claim(0), "claims 10000000000 and"),
    "draco edgebreaker claim": (draco_claim(1), "claims 10000000000 and"),
    "own child": (changed(quad(), "nodes", 0, "children", value=[0]), r"nodes\[0\] hangs from"),
    "two parents": (
        changed(quad(), "nodes", value=[{}, {"children": [0]}, {"children": [0]}]),
        r"nodes\[0\] is a child of two nodes",
    ),
    "circle": (
        changed(quad(), "nodes", value=[{"children": [1], "mesh": 0}, {"children": [0]}]),
        r"nodes\[0\] hangs from itself",
    ),
    "deep nodes": (chain(20_000), "more than 1000 nodes below its root"),
    "child": (changed(quad(), "nodes", 0, "children", value=[7]), r"children\[0\] is 7, but"),
    "NaN in weights": (nan_weights(), r"accessors\[\d+\]: element 1 is not finite"),
    "infinite key": (nan_key(), r"accessors\[5\]: element 2 is not finite"),
    "no node": (changed(ball(), "nodes", 1, value=3), r"nodes\[1\] is 3, not an object"),
    "rotation": (
        changed(ball(), "nodes", 1, "rotation", value=[0, 0, True, 1]),
        r"nodes\[1\].rotation holds True, which is not a number",
    ),
    "channel": (
        changed(ball(), "animations", 0, "channels", 1, "target", "path", value=5),
        r"animations\[0\].channels\[1\].target.path is 5, not a text",
    ),
    "target": (
        changed(ball(), "animations", 0, "channels", 1, "target", value=[]),
        r"animations\[0\].channels\[1\].target is a list, not an object",
    ),
    "sampler": (
        changed(ball(), "animations", 0, "samplers", 2, "output", value=99),
        r"animations\[0\].samplers\[2\].output is 99, but there are",
    ),
    "interpolation": (
        changed(ball(), "animations", 0, "samplers", 2, "interpolation", value="x"),
        r"samplers\[2\].interpolation is 'x', not one of STEP, LINEAR, CUBICSPLINE",
    ),
    "no joints": (changed(ball(), "skins", 0, "joints", value=[]), r"skins\[0\].joints is missing"),
    "joint": (changed(ball(), "skins", 0, "joints", value=[1, 99]), r"joints\[1\] is 99, but"),
    "few joints": (changed(ball(), "skins", 0, "joints", value=[1]), "of a skin of 1 joints"),
    "few matrices": (
        changed(ball(), "skins", 0, "joints", value=[1, 3, 0]),
        r"skins\[0\].inverseBindMatrices are 2, but there are 3 joints",
    ),
    "target length": (
        changed(ball(), "meshes", 0, "weights", value=[1, 2]),
        r"meshes\[0\].weights has 2 numbers, not 1",
    ),
    "endless clip": (endless_clip(), "more than 100000 frames"),
    "climbing": (with_buffer("../secret.bin"), "leads out of the folder"),
    "climbing, encoded": (with_buffer("a/%2e%2e/%2E./secret.bin"), "leads out of the folder"),
    "climbing, Windows": (with_buffer("a\\..\\..\\secret.bin"), "leads out of the folder"),
    "absolute": (with_buffer("/etc/passwd"), "leads out of the folder"),
    "drive": (with_buffer("C:/secret.bin"), "names another place"),
    "drive, encoded": (with_buffer("C%3A/secret.bin"), "leads out of the folder"),
    "web": (with_buffer("https://example.org/a.bin"), "names another place"),
    "file scheme": (with_buffer("file:///etc/passwd"), "names another place"),
    "folder": (with_buffer("."), "no name of a file|is not a file"),
    "NUL": (with_buffer("a%00b"), "no name of a file"),
    "missing": (with_buffer("gone.bin"), "names 'gone.bin', which cannot be read"),
    "not base64": (with_buffer("data:application/octet-stream;base64,????"), "not base64"),
    "plain data": (with_buffer("data:,abc"), "not in base64"),
}


def outcome(path: Path) -> str:
    """Read all of a file; return why it cannot be read, in one line."""
    error = failure(path)
    if error is None:
        return ""
    assert str(error).startswith(f"{path}: ")
    assert "\n" not in str(error)
    assert len(str(error)) < 500
    return error.message


def failure(path: Path) -> InputError | None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            for mesh in GltfReader().read(str(path)).meshes:
                mesh[0], mesh[-1]
        except InputError as error:
            return error
    return None


@pytest.mark.parametrize("name", FILES)
def test_hostile_files_are_one_line(tmp_path, name):
    data, wanted = FILES[name]
    path = tmp_path / "hostile.glb"
    path.write_bytes(data)
    tracemalloc.start()
    found = outcome(path)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < MOST_MEMORY
    assert re.search(wanted, found), found


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """List the places of all values of a document but itself."""
    if path:
        yield path
    if isinstance(value, (dict, list)):
        for key, each in value.items() if isinstance(value, dict) else enumerate(value):
            yield from places(each, (*path, key))


@pytest.mark.parametrize("part", ["nodes", "meshes", "skins", "animations"])
def test_any_value_may_be_nonsense(tmp_path, part):
    made = ball()
    path = tmp_path / "hostile.glb"
    tried = refused = 0
    document = copy.deepcopy(made.json)
    for place in places(document[part], (part,)):
        for value in NASTY:
            made.json = copy.deepcopy(document)
            path.write_bytes(changed(made, *place, value=value))
            refused += bool(outcome(path))
            tried += 1
    assert tried > 50
    assert refused > 0.5 * tried


@pytest.mark.parametrize(
    ("part", "number"), [("accessors", 0), ("accessors", 5), ("bufferViews", 3)]
)
def test_any_value_of_an_array_may_be_nonsense(tmp_path, part, number):
    made = ball()
    path = tmp_path / "hostile.glb"
    document = copy.deepcopy(made.json)
    for name in document[part][number]:
        for value in NASTY:
            made.json = copy.deepcopy(document)
            path.write_bytes(changed(made, part, number, name, value=value))
            assert outcome(path), (name, value)


def test_points_that_overflow_are_named_with_their_frame(tmp_path):
    made = quad()
    made.animate(0, "scale", [0, 1], [[1, 1, 1], [1e38, 1e38, 1e38]])
    made.add("nodes", children=[0], scale=[1e38, 1, 1])
    mesh = GltfReader(fps=1).read(made.save(tmp_path / "far.glb")).meshes[0]
    mesh[0]
    with pytest.raises(InputError, match=r"/node1/quad: frame 1: point 1 is too far"):
        mesh[1]


@pytest.mark.parametrize(
    ("times", "dtype", "wanted"),
    [
        (
            [0, 40000],
            "u2",
            r"accessors\[2\].componentType is of integers; times of keys are floats",
        ),
        ([1, 0], "f4", r"accessors\[2\]: times of keys decrease"),
    ],
)
def test_times_of_keys_are_floats_that_do_not_decrease(tmp_path, times, dtype, wanted):
    made = quad()
    made.animate(0, "translation", [0, 1], np.zeros((2, 3)))
    sampler = made.json["animations"][0]["samplers"][0]
    made.json["accessors"][sampler["input"]] = made.json["accessors"][made.accessor(times, dtype)]
    with pytest.raises(InputError, match=wanted):
        GltfReader().read(made.save(tmp_path / "times.glb"))


@pytest.mark.parametrize("codec", ["meshopt", "DracoPy"])
def test_malformed_compressed_data_is_named(tmp_path, codec):
    pytest.importorskip(codec, reason=f"{codec}, an optional library, is absent")
    made = quad()
    if codec == "meshopt":
        packed = {"buffer": 0, "byteLength": 40, "count": 4, "byteStride": 12}
        extension = {"EXT_meshopt_compression": {**packed, "mode": "ATTRIBUTES"}}
        made.json["bufferViews"][0]["extensions"] = extension
    else:
        view = made.view(b"DRACO\2\2\1\1\0\0\0\4\4" + bytes(range(100)))
        draco = {"bufferView": view, "attributes": {"POSITION": 0}}
        primitive(made)["extensions"] = {"KHR_draco_mesh_compression": draco}
    path = tmp_path / "hostile.glb"
    path.write_bytes(made.binary())
    assert "cannot be decoded" in outcome(path)


@pytest.mark.parametrize("name", ["accessor count", "climbing", "deep JSON", "draco claim"])
def test_commands_end_with_one_line(tmp_path, monkeypatch, capsys, name):
    path = tmp_path / "hostile.glb"
    path.write_bytes(FILES[name][0])
    assert inspect(path, monkeypatch) == 3
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.startswith(f"error: {path}: ")
    assert told.err.count("\n") == 1


def inspect(path: Path, monkeypatch: pytest.MonkeyPatch) -> int | str | None:
    monkeypatch.setattr(sys, "argv", ["meshmark", "inspect", str(path)])
    with pytest.raises(SystemExit) as end:
        main()
    return end.value.code


def test_names_are_told_in_one_line(tmp_path, monkeypatch, capsys):
    made = quad()
    made.json["nodes"][0]["name"] = "a\nb\x1b[31m"
    made.json["animations"] = [{"name": "x\ny\x1b[31m"}, {"name": "z\r"}]
    assert inspect(Path(made.save(tmp_path / "odd.glb")), monkeypatch) == 1
    told = capsys.readouterr().out
    assert "\x1b" not in told
    assert "/a_b__31m: 1 frame of no time" in told
    assert r"clip 'x\ny\x1b[31m' is read; there is also 'z\r'" in told


def test_a_buffer_that_is_a_pipe_is_refused(tmp_path):
    if not hasattr(os, "mkfifo"):
        pytest.skip("pipes are Unix's")
    os.mkfifo(tmp_path / "pipe.bin")
    made = quad()
    source = made.save_with_buffer(tmp_path / "a.gltf", "pipe.bin")
    with pytest.raises(InputError, match=r"'pipe\.bin', which is not a file"):
        GltfReader().read(source)


def test_morph_targets_without_data_take_the_count_of_their_mesh(tmp_path):
    made = quad()
    target = made.add("accessors", **{**made.describe(QUAD), "count": HUGE})
    primitive(made)["targets"] = [{"POSITION": target}]
    path = tmp_path / "hostile.glb"
    path.write_bytes(made.binary())
    assert outcome(path) == f"accessors[{target}].count is {HUGE}, not 4"
