"""A distribution of a stranger, installed beside meshmark, is used like a built-in."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from folders import TESTS
from meshmark import Asset, Key, write
from meshmark.demo import creature

OPTIONS = ["--key", "studio.key", "--scheme", "tsai2014", "--segmenter", "halves"]


def with_site(site: Path) -> dict[str, str]:
    """Environment with what is installed in `site` on the path."""
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")]),
    }


def meshmark(site: Path, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command in a folder, with what is installed in `site` on the path."""
    return subprocess.run(
        [sys.executable, "-c", "from meshmark.cli import main; main()", *arguments],
        cwd=folder,
        env=with_site(site),
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


@pytest.fixture(scope="module")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with a small creature and a key, always the same one."""
    folder = tmp_path_factory.mktemp("workshop")
    asset = Asset("creature", (creature(points=3000, frames=2),), "memory")
    write(asset, asset, folder / "creature.usdc")
    Key(bytes(32)).save(folder / "studio.key")
    return folder


def test_is_listed_and_passes_the_check(third_party_site: Path, tmp_path: Path) -> None:
    listed = meshmark(third_party_site, tmp_path, "plugins", "list", "--json")
    assert listed.returncode == 0, listed.stderr
    assert "halves" in listed.stdout
    assert "meshmark-halves" in listed.stdout
    checked = meshmark(third_party_site, tmp_path, "plugins", "check", "halves")
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_passes_the_suite_its_author_subclassed(third_party_site: Path, tmp_path: Path) -> None:
    shutil.copy(TESTS / "third_party_segmenter" / "test_halves.py", tmp_path)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_halves.py"],
        cwd=tmp_path,
        env=with_site(third_party_site),
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stdout
    assert " passed" in done.stdout


def test_is_unknown_where_it_is_not_installed(tmp_path: Path) -> None:
    listed = meshmark(tmp_path, tmp_path, "plugins", "list", "--json")
    assert listed.returncode == 0, listed.stderr
    assert "halves" not in listed.stdout


@pytest.mark.slow
def test_embed_and_verify_use_it(third_party_site: Path, workshop: Path) -> None:
    given = [*OPTIONS, "--set", "halves.cut=0.25", "--json"]
    embedded = meshmark(
        third_party_site, workshop, "embed", "creature.usdc", "-o", "marked.usda", *given
    )
    assert embedded.returncode in (0, 1), embedded.stderr
    segmenter = json.loads(embedded.stdout)["plugins"]["segmenter"]
    assert segmenter["name"] == "halves"
    assert segmenter["distribution"] == "meshmark-halves"
    assert segmenter["parameters"] == {"cut": 0.25}

    # Two parts of sixteen chips hold no more than a mark of one in a thousand.
    asked = ["verify", "marked.usda", "--fpr", "1e-3"]
    verified = meshmark(third_party_site, workshop, *asked, *given)
    assert verified.returncode == 0, verified.stderr
    [asset] = json.loads(verified.stdout)["assets"]
    assert asset["verdict"] == "marked"

    # The mark hangs on these parts: cut the mesh in another way, and there is none.
    elsewhere = [*OPTIONS[:-1], "sdf"]
    missed = meshmark(third_party_site, workshop, *asked, *elsewhere)
    assert missed.returncode == 1, missed.stderr


def test_its_refusal_is_the_users_mistake(third_party_site: Path, workshop: Path) -> None:
    given = [*OPTIONS, "--set", "halves.cut=7"]
    done = meshmark(
        third_party_site, workshop, "embed", "creature.usdc", "-o", "never.usda", *given
    )
    assert done.returncode == 2
    assert "cut must lie within" in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(workshop.glob("never*"))
