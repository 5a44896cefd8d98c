"""Fixtures that more than one test file asks for."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import settings

from folders import REPOSITORY, TESTS
from meshmark.demo import creature as build_creature
from meshmark.mesh.animation import MeshAnimation

# How long an example takes says something of the machine, not of what is tested.
settings.register_profile("meshmark", deadline=None)
settings.load_profile("meshmark")


# Commands in tests inherit what is ignored, and whoever runs tests in the background, or by nohup,
# has signals ignored that some of the tests send.
for _name, _usual in (("SIGINT", signal.default_int_handler), ("SIGHUP", signal.SIG_DFL)):
    _signal = getattr(signal, _name, None)
    if _signal is not None and signal.getsignal(_signal) is signal.SIG_IGN:
        signal.signal(_signal, _usual)


# A distribution of its own; test_third_party_plugin.py installs it and runs its tests.
collect_ignore = ["third_party_segmenter"]


@pytest.fixture(scope="session", autouse=True)
def evidence_secret(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Keep the tests' evidence apart from the user's."""
    os.environ["MESHMARK_EVIDENCE_SECRET"] = str(tmp_path_factory.mktemp("secret") / "secret")


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Folder of the reference assets, which are not part of the repository."""
    folder = Path(os.environ.get("MESHMARK_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"reference assets are not at {folder}; set MESHMARK_DATA to their folder")
    return folder


@pytest.fixture(scope="session")
def creature() -> MeshAnimation:
    """Galloping creature of some 7000 points, 24 frames; one stride, which loops."""
    return build_creature()


@pytest.fixture(scope="session")
def third_party_site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder a stranger's segmenter distribution was installed into; put it on PYTHONPATH."""
    site = tmp_path_factory.mktemp("site")
    source = TESTS / "third_party_segmenter"
    # Without dependencies and isolation nothing is asked of a package index.
    options = ["--quiet", "--no-deps", "--no-build-isolation", "--no-cache-dir"]
    done = subprocess.run(
        [sys.executable, "-m", "pip", "install", *options, "--target", str(site), str(source)],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return site
