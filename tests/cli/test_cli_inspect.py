"""What `meshmark inspect` says is true: meshes, points, frames, times, rigs, and why not."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import pytest
from pxr import Usd, UsdGeom, UsdSkel

from command_line import command
from meshmark.commands.inspect import inspect_asset
from meshmark.errors import InputError
from meshmark.extension.recipe import Recipe
from meshmark.sources.reading import read
from usd_stages import FRAMES, cube, sampled, write_text

RELIEF = ("--scheme", "relief", "--trusted")


def test_frames_times_and_places(tmp_path, monkeypatch, capsys) -> None:
    doubled = "int[] faceVertexCounts = [3]\nint[] faceVertexIndices = [0, 1, 3]\n"
    body = cube("moving", points=sampled(FRAMES)) + cube("still")
    body += f"""
    def Mesh "seam"
    {{
        {doubled}
        point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 0, 0), (0, 1, 0)]
    }}
    """
    source = write_text(tmp_path / "a.usda", body)
    assert command(monkeypatch, "inspect", source, *RELIEF) == 1
    out = capsys.readouterr().out
    assert "/moving: 3 frames from 1 to 4.5, 8 points, 6 faces" in out
    assert "/still: 1 frame of no time, 8 points, 6 faces" in out
    assert "/seam: 1 frame of no time, 4 points at 3 places, 1 faces" in out
    assert out.count("cannot hold a mark: ") == 3


def test_all_schemes_say_why_not(tmp_path) -> None:
    [prim] = inspect_asset(read(write_text(tmp_path / "a.usda", cube())))["prims"]
    apex, relief = prim["reason"].split("; relief: ")
    assert apex.startswith("apex: ")
    assert relief == "8 points have room for 2 chips; it takes 26"


def test_what_is_left_out_counts(tmp_path, monkeypatch, capsys) -> None:
    lost = cube("lost", points="point3f[] points = []")
    guide = cube("guide", more='uniform token purpose = "guide"')
    write_text(tmp_path / "both.usda", cube("fit") + lost + guide)
    assert command(monkeypatch, "inspect", tmp_path / "both.usda", *RELIEF, "--json") == 1
    document = json.loads(capsys.readouterr().out)
    assert document["left_out"] == [
        {"prim": "/guide", "reason": "purpose guide", "guide": True},
        {"prim": "/lost", "reason": "the mesh has no points", "guide": False},
    ]


# Real input --------------------------------------------------------------------------------------


def told(file: Path) -> list[dict[str, Any]]:
    document = inspect_asset(read(file), Recipe("relief"))
    return list(document["prims"])


def rigged(prim: dict[str, Any]) -> bool:
    return any(note.startswith("rigged: posed by") for note in prim["notes"])


def usd_times(mesh: UsdGeom.Mesh) -> set[float]:
    """Return the times at which a skeleton, or the points, are sampled."""
    prim, times = mesh.GetPrim(), set(mesh.GetPointsAttr().GetTimeSamples())
    skeleton = UsdSkel.BindingAPI(prim).GetInheritedSkeleton()
    if UsdSkel.Root.Find(prim) and skeleton:
        target = UsdSkel.BindingAPI(skeleton).GetInheritedAnimationSource()
        animation = UsdSkel.Animation(target)
        times.update(*(each.GetTimeSamples() for each in animation.GetPrim().GetAttributes()))
    return times


@pytest.mark.slow
def test_stages(data_folder: Path) -> None:
    found = 0
    for file in sorted((data_folder / "usd").rglob("*.usd*")):
        try:
            stage = Usd.Stage.Open(str(file))
        except Exception:
            with pytest.raises(InputError, match="not readable as USD"):
                read(file)
            continue
        meshes = {str(p.GetPath()): UsdGeom.Mesh(p) for p in stage.Traverse()}
        meshes = {path: mesh for path, mesh in meshes.items() if mesh}
        if not meshes:
            with pytest.raises(InputError, match="the stage holds no mesh"):
                read(file)
            continue
        prims = told(file)
        assert [prim["prim"] for prim in prims] == list(meshes)
        for prim, mesh in zip(prims, meshes.values(), strict=True):
            code, times = Usd.TimeCode.EarliestTime(), usd_times(mesh)
            assert prim["points"] == len(mesh.GetPointsAttr().Get(code))
            assert prim["faces"] == len(mesh.GetFaceVertexCountsAttr().Get(code))
            assert prim["frames"] == max(1, len(times))
            assert prim["times"] == ([min(times), max(times)] if times else None)
            assert rigged(prim) == (len(times) > len(mesh.GetPointsAttr().GetTimeSamples()))
            varies = mesh.GetFaceVertexCountsAttr().ValueMightBeTimeVarying()
            assert prim["constant_topology"] != varies
            assert prim["can_hold"] == (prim["places"] >= 100)
            found += 1
    assert found == 170


def gltf_document(file: Path) -> dict[str, Any]:
    data = file.read_bytes()
    if data[:4] == b"glTF":
        [length] = struct.unpack("<I", data[12:16])
        data = data[20 : 20 + length]
    return dict(json.loads(data))


@pytest.mark.slow
def test_gltf(data_folder: Path) -> None:
    files = sorted((data_folder / "gltf").iterdir())
    assert len(files) == 7
    for file in files:
        document = gltf_document(file)
        accessors = document["accessors"]
        [mesh] = document["meshes"]
        positions = {each["attributes"]["POSITION"] for each in mesh["primitives"]}
        keys = max(
            accessors[each["input"]]["count"] for each in document["animations"][0]["samplers"]
        )
        [prim] = told(file)
        assert prim["points"] == sum(accessors[each]["count"] for each in positions)
        assert prim["frames"] == keys
        assert prim["times"] == [0, keys - 1]
        assert rigged(prim)
        assert prim["can_hold"]
