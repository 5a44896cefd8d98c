"""The validators run in usd-core's own registry, and find what `meshmark check` finds."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdValidation, Vt

from command_line import command
from meshmark.commands.check import check_file
from meshmark.embedding.file import mark_file
from meshmark.embedding.manifest import manifest_path
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.testing.meshes import bumpy_sphere
from meshmark.testing.schemas import schema_folder
from meshmark.usd.plugin import register
from meshmark.usd.stages import write_stage
from usd_stages import CUBE_INDICES, CUBE_POINTS

pytestmark = pytest.mark.skipif(
    not hasattr(UsdValidation.ValidationRegistry, "RegisterPluginStageValidator"),
    reason="usd-core before 26.5 has no validators in Python",
)
KEY, RECIPE = Key(bytes(range(32))), Recipe("cho2007")
PLUGIN = "meshmark.validation"
SPHERE = bumpy_sphere(3, np.eye(3))


def source_of(path: Path, n_frames: int) -> Path:
    """Write a growing ball, and beside it a cube, which can hold no mark."""
    V, F = SPHERE
    ball = MeshAnimation.from_arrays(
        np.stack([(1 + 0.1 * t) * V for t in range(n_frames)]), F, prim="/World/ball"
    )
    corners = np.array(CUBE_INDICES).reshape(-1, 4)
    cube = MeshAnimation.from_arrays(CUBE_POINTS, corners[:, :3], prim="/World/cube")
    write_stage(Asset("test", (ball, cube), "test"), path)
    return path


@pytest.fixture(scope="module")
def studio(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a source, an override of it, one of a frame, and a deliverable."""
    folder = tmp_path_factory.mktemp("studio")
    source = source_of(folder / "s.usda", 2)
    for name, more in (
        ("marked.usda", {}),
        ("one.usda", {"frames": "2:2"}),
        ("out.usda", {"deliver": True, "allow_unmarked": ["/World/cube"]}),
    ):
        mark_file(source, folder / name, KEY, recipe=RECIPE, **more)
    return folder


@pytest.fixture
def files(studio: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(studio, tmp_path / "files"))


def validated(file: Path | Usd.Stage, names: list[str] | None = None) -> list[tuple[str, str]]:
    """Run our validators, as usd-core finds them, and tell errors and their prims."""
    register()
    registry = UsdValidation.ValidationRegistry()
    told = registry.GetValidatorMetadataForKeyword("Meshmark")
    validators = registry.GetOrLoadValidatorsByName(names or [each.name for each in told])
    stage = file if isinstance(file, Usd.Stage) else Usd.Stage.Open(str(file))
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    return sorted((error.GetName(), str(_site(error))) for error in errors)


def _site(error: UsdValidation.ValidationError) -> Sdf.Path:
    [site] = error.GetSites()
    return (site.GetPrim() if site.IsPrim() else site.GetProperty()).GetPath()


def checked(file: Path) -> set[tuple[str, str]]:
    """Run the command's own function, and tell what it finds."""
    document = check_file(file, trusted=True)
    schema = json.loads((schema_folder("json") / "check.schema.json").read_text())
    jsonschema.validate(document, schema)
    return {(each["kind"], each["where"]) for each in document["findings"]}


def test_usd_core_knows_the_validators() -> None:
    register()
    registry = UsdValidation.ValidationRegistry()
    told = registry.GetValidatorMetadataForKeyword("Meshmark")
    assert {each.name for each in told} == {
        f"{PLUGIN}:{name}"
        for name in ("UnmarkableMesh", "StaleOverride", "UnmarkedPoints", "UnmarkedFrames")
    }
    assert all(each.doc for each in told)


def test_a_mesh_that_can_hold_no_mark(files: Path) -> None:
    assert validated(files / "s.usda") == [("Unmarkable", "/World/cube")]
    assert checked(files / "s.usda") == {("unmarkable", "/World/cube")}


def test_what_is_as_it_was_marked_is_in_order(files: Path) -> None:
    for name, gives in (("marked.usda", {("layer", "./s.usda")}), ("out.usda", set())):
        assert validated(files / name) == []
        assert checked(files / name) == gives


def test_a_source_that_changed_since(files: Path) -> None:
    source_of(files / "s.usda", 3)
    expected = [("Stale", "/"), ("UnmarkedFrames", "/World/ball")]
    assert validated(files / "marked.usda") == expected
    assert {("stale", "s.usda"), ("frames", "/World/ball")} <= checked(files / "marked.usda")
    # A layer above is no better.
    shot = Sdf.Layer.CreateNew(str(files / "shot.usda"))
    shot.subLayerPaths.append("./marked.usda")
    shot.Save()
    assert set(expected) <= set(validated(files / "shot.usda"))
    # A deliverable needs no source.
    assert validated(files / "out.usda") == []
    (files / "s.usda").unlink()
    assert ("Stale", "/") in validated(files / "marked.usda")


def test_frames_that_hold_no_mark(files: Path) -> None:
    assert validated(files / "one.usda") == [("UnmarkedFrames", "/World/ball")]
    assert ("frames", "/World/ball") in checked(files / "one.usda")


def test_unmarked_points_in_a_deliverable(files: Path) -> None:
    stage = Usd.Stage.Open(str(files / "out.usda"))
    api = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World/ball"))
    rest = Vt.Vec3fArray.FromNumpy(SPHERE[0].astype(np.float32))
    api.CreatePrimvar("rest", Sdf.ValueTypeNames.Point3fArray, "vertex").Set(rest)
    stage.Save()
    place = "/World/ball.primvars:rest"
    # Its manifest is of the file as it was.
    assert validated(files / "out.usda") == [("Stale", "/"), ("UnmarkedCopy", place)]
    assert checked(files / "out.usda") == {("copy", place), ("stale", "out.usda")}
    # Studios' own stages may have rest poses.
    manifest_path(files / "out.usda").unlink()
    assert ("UnmarkedCopy", place) not in validated(files / "out.usda")


def test_no_validator_ends_the_run(files: Path) -> None:
    bare = files / "bare.usda"
    bare.write_text("#usda 1.0\n")
    builtin = "usdValidation:StageMetadataChecker"
    alone = validated(bare, [builtin])
    assert alone
    manifest_path(bare).write_text("[]")
    failing = [f"{PLUGIN}:{name}" for name in ("StaleOverride", "UnmarkedPoints")]
    assert validated(bare, [builtin, *failing]) == sorted([*alone, *[("Failed", "/")] * 2])


def test_a_stage_without_a_file_is_not_looked_at() -> None:
    assert validated(Usd.Stage.CreateInMemory(), [f"{PLUGIN}:StaleOverride"]) == [("NoFile", "/")]


@pytest.mark.parametrize("more", [["--trusted"], pytest.param([], marks=pytest.mark.slow)])
def test_check_says_it_on_the_command_line(
    files: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    more: list[str],
) -> None:
    monkeypatch.chdir(files)
    assert command(monkeypatch, "check", "s.usda", *more) == 1
    assert "unmarkable: /World/cube: relief: " in capsys.readouterr().out
    assert command(monkeypatch, "check", "out.usda", *more) == 0
