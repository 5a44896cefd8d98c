"""Inputs altered at random, through the commands: `python -m fuzz` in small."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from random import Random

import pytest

from fuzz.texts import LONGEST, _lengthen

HERE = Path(__file__).parent


def fuzz(*arguments: str) -> subprocess.CompletedProcess[str]:
    # A process of its own: it forks, which needs one without threads.
    return subprocess.run(
        [sys.executable, "-m", "fuzz", *arguments],
        cwd=HERE,
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )


def assert_clean(done: subprocess.CompletedProcess[str], count: int) -> None:
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{count} inputs in " in done.stdout
    assert "0 faults of 0 kinds" in done.stdout


@pytest.mark.slow
def test_a_few_inputs_of_every_kind() -> None:
    done = fuzz("--count", "100", "--seed", "1")
    assert_clean(done, 100)
    kinds = ("usda", "usdc", "usdz", "obj", "gltf", "evidence", "store", "key", "names", "manifest")
    for kind in kinds:
        assert f"{kind} " in done.stdout


def test_a_word_lengthened_again_and_again_fits_into_memory() -> None:
    data, rng = b"a", Random(0)
    for _ in range(8):
        data = _lengthen(data, rng, ())
    assert LONGEST // 2 < len(data) <= LONGEST


@pytest.mark.slow
def test_many_inputs() -> None:
    assert_clean(fuzz("--count", "1000", "--seed", "2"), 1000)
