"""The viewer in the package is what its sources and the lockfile say, byte for byte."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from folders import REPOSITORY
from meshmark.reporting.page import ASSETS

VIEWER = REPOSITORY / "viewer"


def test_versions_are_pinned() -> None:
    package = json.loads((VIEWER / "package.json").read_text("utf-8"))
    locked = json.loads((VIEWER / "package-lock.json").read_text("utf-8"))["packages"]
    for name, version in (package["dependencies"] | package["devDependencies"]).items():
        assert locked[f"node_modules/{name}"]["version"] == version
        assert locked[f"node_modules/{name}"]["integrity"].startswith("sha512-")


def test_the_bundle_is_small_and_names_its_licence() -> None:
    script = (ASSETS / "viewer.js").read_text("utf-8")
    assert len(script.encode()) < 600_000
    assert "SPDX-License-Identifier: MIT" in script
    assert "</script" not in script
    assert "three.js authors" in (ASSETS / "viewer.LICENSE.txt").read_text("utf-8")


@pytest.mark.slow
def test_the_bundle_is_built_of_these_sources(tmp_path: Path) -> None:
    npm = shutil.which("npm")
    if npm is None:
        pytest.skip("npm is not installed")
    folder = tmp_path / "viewer"
    shutil.copytree(VIEWER, folder, ignore=shutil.ignore_patterns("node_modules"))
    built = tmp_path / ASSETS.relative_to(REPOSITORY)
    built.mkdir(parents=True)
    options = {"cwd": folder, "capture_output": True, "text": True, "timeout": 300}
    fetched = subprocess.run([npm, "ci", "--no-audit", "--no-fund"], check=False, **options)
    if fetched.returncode:
        pytest.skip(f"npm cannot fetch three.js and esbuild: {fetched.stderr[-300:]}")
    subprocess.run([npm, "run", "build"], check=True, **options)
    assert (built / "viewer.js").read_bytes() == (ASSETS / "viewer.js").read_bytes()
    licence = folder / "node_modules" / "three" / "LICENSE"
    assert licence.read_bytes() == (ASSETS / "viewer.LICENSE.txt").read_bytes()
