"""Whichever way USD composes a mesh: it is marked, found in the stage, and nothing else changes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from pxr import Usd

from command_line import command
from composed_stages import ARCS, Shape
from meshmark.keys import Key
from meshmark.testing.informed_schemes import horned
from meshmark.usd.reading import read_stage
from stage_comparison import MOVED, differences

MARK = ("--key", "k", "--scheme", "relief", "--trusted")


@pytest.mark.slow
@pytest.mark.parametrize("arc", ARCS)
def test_every_mesh_is_marked_and_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arc: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Key(bytes(range(32))).save(Path("k"))
    shape = Shape.of(horned()[0].faces, tuple(frame.points for frame in horned()))
    source = ARCS[arc](tmp_path, shape)
    meshes = read_stage(source).meshes
    # Of those that instances share, the first.
    wanted = set({mesh.shared or mesh.prim: mesh.prim for mesh in meshes[::-1]}.values())
    code = command(monkeypatch, "embed", source, "-o", "o.usdc", *MARK, "--json")
    marked = json.loads(capsys.readouterr().out)
    assert code == 0
    assert {each["prim"] for each in marked["prims"]} == wanted
    allowed = {mesh.prim: MOVED for mesh in meshes}
    before, after = Usd.Stage.Open(source), Usd.Stage.Open("o.usdc")
    assert differences(before, after, allowed) == []
    copies = ["o.usdc"]
    if any(mesh.shared for mesh in meshes):
        copies.append("flat.usdc")
        after.Flatten().Export("flat.usdc")
    beside = ("--original", source, "--json")
    for copy in copies:
        assert command(monkeypatch, "verify", copy, *MARK, *beside) == 0
        [found] = json.loads(capsys.readouterr().out)["assets"]
        assert found["verdict"] == "marked"
        told = {name: each for each in found["prims"] for name in (each["prim"], *each["also"])}
        assert {name for name, each in told.items() if each["verdict"] == "marked"} >= wanted
