"""A rigged mesh is marked on the command line, and found in whatever its rig makes of it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdSkel

from command_line import command
from meshmark.keys import Key
from meshmark.testing.informed_schemes import horned
from rigged_stages import Rigged, baked_by_usd

BENDS = {1: 0.0, 2: 15.0, 3: 40.0}


@pytest.fixture(scope="module")
def studio(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a rigged creature, and copies of it that are baked, and rigged."""
    folder = tmp_path_factory.mktemp("studio")
    Key(bytes(range(32))).save(folder / "k")
    Key(bytes(range(1, 33))).save(folder / "other")
    frame = horned()[0]
    rigged = Rigged.at(folder / "man.usda")
    counts, corners = frame.topology.counts, frame.topology.indices
    rigged.add("/man/body", frame.points, counts.tolist(), corners.tolist())
    rigged.turn_elbow(BENDS)
    rigged.save()
    mark = ("--key", "k", "--scheme", "relief")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for skel in ("bake", "rest"):
            marked = ("man.usda", *mark, "--skel", skel, "-o")
            assert command(patch, "embed", *marked, f"{skel}.usda") == 0
            assert command(patch, "embed", *marked, f"{skel}-all.usdc", "--deliver") == 0
    return folder


def verdict(studio: Path, patch: pytest.MonkeyPatch, copy: str, key: str = "k") -> int:
    patch.chdir(studio)
    return command(
        patch, "verify", copy, "--key", key, "--original", "man.usda", "--scheme", "relief"
    )


@pytest.mark.slow
@pytest.mark.parametrize("copy", ["bake.usda", "rest.usda", "bake-all.usdc", "rest-all.usdc"])
def test_the_mark_is_found_and_is_nobody_else_s(
    studio: Path, monkeypatch: pytest.MonkeyPatch, copy: str
) -> None:
    assert verdict(studio, monkeypatch, copy) == 0
    assert verdict(studio, monkeypatch, copy, key="other") == 1


def test_the_source_is_not_marked(studio: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert verdict(studio, monkeypatch, "man.usda") == 1


def test_a_rigged_copy_that_was_baked(studio: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    baked_by_usd(str(studio / "rest-all.usdc")).Export(str(studio / "baked.usda"))
    stage = Usd.Stage.Open(str(studio / "baked.usda"))
    assert not any(prim.IsA(UsdSkel.Root) for prim in stage.Traverse())
    assert verdict(studio, monkeypatch, "baked.usda") == 0


def test_a_rigged_copy_that_moves_backwards(studio: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Usd.Stage.Open(str(studio / "rest-all.usdc"))
    rotations = UsdSkel.Animation(stage.GetPrimAtPath("/man/walk")).GetRotationsAttr()
    values = [rotations.Get(time) for time in BENDS]
    for time, value in zip(BENDS, values[::-1], strict=True):
        rotations.Set(value, time)
    stage.Export(str(studio / "backwards.usda"))
    assert verdict(studio, monkeypatch, "backwards.usda") == 0


def test_the_manifest_tells_what_became_of_rigs(studio: Path) -> None:
    for skel in ("bake", "rest"):
        document = json.loads((studio / f"{skel}.usda.meshmark.json").read_text())
        assert document["skel"] == skel
        assert document["primvars"] == "follow"
        assert document["prims"][0]["notes"] == ["rigged: posed by /man/bones"]
        assert 0 < document["prims"][0]["distortion"]["mrms_rel"] < 1e-3


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--skel", "both"), "must be bake or rest"),
        (("--primvars", "both"), "must be follow or keep"),
        (("--skel", "rest", "--frames", "1:2"), "a rest pose shows in every frame"),
    ],
)
def test_what_cannot_be_is_refused(
    studio: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    words: str,
) -> None:
    monkeypatch.chdir(studio)
    code = command(monkeypatch, "embed", "man.usda", "--key", "k", "-o", "no.usda", *arguments)
    assert code == 2
    assert words in capsys.readouterr().err
    assert not Path("no.usda").exists()


def test_inspect_tells_of_the_rig(
    studio: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(studio)
    assert command(monkeypatch, "inspect", "man.usda", "--scheme", "relief", "--json") == 0
    (prim,) = json.loads(capsys.readouterr().out)["prims"]
    assert prim["notes"] == ["rigged: posed by /man/bones"]
    assert prim["frames"] == len(BENDS)
    assert np.isfinite(prim["chips"])
