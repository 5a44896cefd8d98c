"""A wheel holds both packages, their data and the entry points, and nothing else."""

from __future__ import annotations

import subprocess
import sys
import tomllib
import zipfile
from configparser import ConfigParser

import pytest

from folders import REPOSITORY
from meshmark.demo.build import DATA
from meshmark.testing.schemas import schema_folder


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    folder = tmp_path_factory.mktemp("wheel")
    options = ["--quiet", "--no-deps", "--no-build-isolation", "--disable-pip-version-check"]
    done = subprocess.run(
        [sys.executable, "-m", "pip", "wheel", *options, "--wheel-dir", folder, REPOSITORY],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    [path] = folder.glob("meshmark-*.whl")
    return zipfile.ZipFile(path)


def test_both_packages_are_inside_whole(wheel: zipfile.ZipFile) -> None:
    names = set(wheel.namelist())
    for package in (REPOSITORY / "meshmark", REPOSITORY / "plugins" / "meshmark_plugins"):
        modules = {path.relative_to(package.parent).as_posix() for path in package.rglob("*.py")}
        assert modules
        assert modules <= names


def test_schemas_are_inside(wheel: zipfile.ZipFile) -> None:
    schemas = list(schema_folder("json").glob("*.json"))
    assert schemas
    for path in schemas:
        assert wheel.read(f"meshmark/schemas/json/{path.name}") == path.read_bytes()


def test_the_plugin_of_usd_is_inside(wheel: zipfile.ZipFile) -> None:
    files = [
        "usd/plugin/plugInfo.json",
        "usd/plugin/generatedSchema.usda",
        "usd/plugin/schema.usda",
    ]
    for name in (*files, "validation/plugInfo.json"):
        assert wheel.read(f"meshmark/{name}") == (REPOSITORY / "meshmark" / name).read_bytes()


def test_the_creature_is_inside(wheel: zipfile.ZipFile) -> None:
    assert wheel.read("meshmark/demo/creature.npz") == DATA.read_bytes()


def test_templates_of_plugins_are_inside(wheel: zipfile.ZipFile) -> None:
    templates = list((REPOSITORY / "meshmark" / "commands" / "plugin_templates").rglob("*.txt"))
    assert len(templates) > 15
    for path in templates:
        assert wheel.read(path.relative_to(REPOSITORY).as_posix()) == path.read_bytes()


def test_the_parts_of_reports_are_inside(wheel: zipfile.ZipFile) -> None:
    assets = list((REPOSITORY / "meshmark" / "reporting" / "assets").iterdir())
    assert {"page.html", "page.css", "viewer.js", "viewer.LICENSE.txt"} == {a.name for a in assets}
    for path in assets:
        assert wheel.read(path.relative_to(REPOSITORY).as_posix()) == path.read_bytes()


def test_nothing_else_is_inside(wheel: zipfile.ZipFile) -> None:
    tops = {name.partition("/")[0] for name in wheel.namelist()}
    assert {top.partition("-")[0] for top in tops} == {"meshmark", "meshmark_plugins"}


def test_type_checkers_may_look_inside(wheel: zipfile.ZipFile) -> None:
    assert {"meshmark/py.typed", "meshmark_plugins/py.typed"} <= set(wheel.namelist())


def test_built_ins_enter_by_the_door_of_strangers(wheel: zipfile.ZipFile) -> None:
    [path] = [name for name in wheel.namelist() if name.endswith("entry_points.txt")]
    found = ConfigParser()
    found.read_string(wheel.read(path).decode())
    assert found["console_scripts"]["meshmark"] == "meshmark.cli:main"
    folders = {path.parent.name for path in (REPOSITORY / "plugins").glob("*/*/__init__.py")}
    # These are called by other programs.
    folders.remove("publish")
    assert {entry.rpartition(".")[2] for entry in found["meshmark"].values()} == folders


def test_every_dependency_says_from_when(wheel: zipfile.ZipFile) -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    [metadata] = [name for name in wheel.namelist() if name.endswith(".dist-info/METADATA")]
    text = wheel.read(metadata).decode()
    for requirement in project["dependencies"]:
        assert ">=" in requirement
        assert f"Requires-Dist: {requirement.partition('>=')[0]}" in text
