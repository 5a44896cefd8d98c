"""Override layers win over every way USD composes a mesh, and change nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd

from composed_stages import ARCS, CUBE, sets, shown_elsewhere, variant, write
from meshmark.mesh.asset import Asset
from meshmark.usd.reading import read_stage
from meshmark.usd.variants import Choice, select
from meshmark.usd.writing import write_override
from rigged_stages import BENDS, bent_tube
from stage_comparison import MOVED, differences
from usd_stages import moved


def assert_only_moved(source: str, output: Path, marked: Asset) -> None:
    """The composed stage shows the marked points, and is else what the source is."""
    allowed = {mesh.prim: MOVED for mesh in marked.meshes}
    # Of those that instances share, the first; one mesh moved for all.
    meshes = list({mesh.shared or mesh.prim: mesh for mesh in marked.meshes[::-1]}.values())
    before, after = Usd.Stage.Open(source), Usd.Stage.Open(str(output))
    assert differences(before, after, allowed) == []
    shown = read_stage(str(output))
    for mesh in meshes:
        own, other = (
            stage.GetPrimAtPath(mesh.prim).GetAttribute("points") for stage in (before, after)
        )
        assert own.GetTimeSamples() == other.GetTimeSamples()
        again = shown.mesh(mesh.prim)
        np.testing.assert_array_equal(again.times, mesh.times)
        for expected, frame in zip(mesh, again, strict=True):
            np.testing.assert_allclose(frame.points, expected.points, rtol=0, atol=1e-5)


@pytest.mark.parametrize("arc", ARCS)
def test_the_override_wins_and_nothing_else_changes(tmp_path: Path, arc: str) -> None:
    source = ARCS[arc](tmp_path, CUBE)
    marked = moved(read_stage(source))
    (tmp_path / "out").mkdir()
    output = tmp_path / "out" / "marked.usda"
    write_override(read_stage(source), marked, output)
    assert_only_moved(source, output, marked)


def test_what_shows_a_marked_prim_follows_it(tmp_path: Path) -> None:
    """An instance that was not asked for."""
    source = shown_elsewhere(tmp_path, CUBE)
    marked = moved(read_stage(source, ["/model/m"]))
    write_override(read_stage(source), marked, tmp_path / "o.usda")
    before, after = Usd.Stage.Open(source), Usd.Stage.Open(str(tmp_path / "o.usda"))
    assert differences(before, after, {"/model/m": MOVED, "/copy/m": MOVED}) == []
    model, copy = read_stage(str(tmp_path / "o.usda")).meshes
    for expected, one, other in zip(marked.meshes[0], model, copy, strict=True):
        np.testing.assert_allclose(one.points, expected.points, rtol=0, atol=1e-6)
        np.testing.assert_allclose(
            other.points, one.points + np.array([9, 0, 0]), rtol=0, atol=1e-6
        )


@pytest.mark.parametrize("skel", ["bake", "rest"])
def test_a_rig_behind_a_reference_and_a_variant(tmp_path: Path, skel: str) -> None:
    """The rig is twice as slow; in another variant nothing animates it, and it stays as it is."""
    bent_tube(tmp_path / "man.usda")
    levels = variant("walk", "") + variant(
        "stand", 'over "bones" { rel skel:animationSource = None }'
    )
    man = "( references = @man.usda@ (offset = 10; scale = 2)"
    body = f"""
    def "a" {sets("gait", gait="walk").replace("(", man, 1)}
    {{
        variantSet "gait" = {{ {levels} }}
    }}
    """
    source = write(tmp_path / "scene.usda", body)
    original = read_stage(source)
    [mesh] = original.meshes
    np.testing.assert_array_equal(mesh.times, [10 + 2 * time for time in BENDS])
    done = write_override(original, moved(original), tmp_path / "o.usda", skel=skel)
    assert done.as_json()["variants"][0]["marked_in"] == ["/a{gait=walk}"]
    stages = [Usd.Stage.Open(str(tmp_path / name)) for name in ("scene.usda", "o.usda")]
    unbound = {"skel:skeleton", "apiSchemas"} if skel == "bake" else set()
    assert differences(*stages, {"/a/arm": MOVED | unbound}) == []
    shown = read_stage(str(tmp_path / "o.usda")).meshes[0]
    np.testing.assert_array_equal(shown.times, mesh.times)
    for expected, frame in zip(moved(original).meshes[0], shown, strict=True):
        # One rest pose does not fit all the moves that a test makes at random.
        near = 1e-6 if skel == "bake" else 5e-3
        np.testing.assert_allclose(frame.points, expected.points, rtol=0, atol=near)
    for stage in stages:
        select(stage, [Choice("/a", "gait", "stand")])
    assert differences(*stages, {}) == []


CHANGES = {
    "/ upAxis": ('upAxis = "Z"', 'upAxis = "Y"'),
    "/a kind": ('"prop"', '"group"'),
    "/a purpose": ('"proxy"', '"guide"'),
    "/a to": ("to = </a>", "to = </a/m>"),
    "/a n": ("2: 2", "2: 3"),
    "/a c": ("</a.n>", "</a.m>"),
    "/a/m specifier": ("def Mesh", "over Mesh"),
    "prims: ['/a/m', '/a/n']": ('"m"', '"n"'),
}


@pytest.mark.parametrize("told", CHANGES)
def test_comparing_stages_sees_differences(tmp_path: Path, told: str) -> None:
    text = """
    def Xform "a" (kind = "prop")
    {
        token purpose = "proxy"
        rel to = </a>
        int n.timeSamples = { 1: 1, 2: 2 }
        int c.connect = </a.n>
        def Mesh "m" {}
    }
    """
    one = write(tmp_path / "one.usda", text, 'upAxis = "Z"')
    (tmp_path / "two.usda").write_text(Path(one).read_text().replace(*CHANGES[told]))
    stages = [Usd.Stage.Open(str(tmp_path / name)) for name in ("one.usda", "two.usda")]
    assert differences(*stages, {}) == [told]
    assert differences(stages[0], stages[0], {}) == []
