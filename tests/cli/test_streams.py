"""Nobody listens, or the disk is full: no exit code that reads as a verdict."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from folders import FAULTS

pytestmark = pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")

COMMANDS = {
    "help": ["--help"],
    "version": ["--version"],
    "list": ["plugins", "list"],
    "json": ["plugins", "list", "--json"],
}
MESHMARK = f"{sys.executable} -P -m meshmark"


def shell(command: str, cwd: Path) -> tuple[int, str]:
    done = subprocess.run(
        ["bash", "-c", command], cwd=cwd, stderr=subprocess.PIPE, text=True, check=False, timeout=60
    )
    return done.returncode, done.stderr


@pytest.mark.parametrize("name", COMMANDS)
def test_a_full_disk_behind_stdout_is_one_line(tmp_path, name) -> None:
    code, said = shell(f"{MESHMARK} {' '.join(COMMANDS[name])} > /dev/full", tmp_path)
    assert (code, said) == (3, "error: stdout: cannot be written: No space left on device\n")


@pytest.mark.parametrize("name", COMMANDS)
def test_a_reader_that_has_gone_is_told_as_a_shell_does(tmp_path, name) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-P", "-m", "meshmark", *COMMANDS[name]]
    done = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, check=False, timeout=60)
    os.close(writing)
    assert (done.returncode, done.stderr) == (141, b"")


@pytest.mark.slow
def test_a_verdict_that_nobody_reads_has_no_verdicts_exit_code() -> None:
    source, key = FAULTS / "two-recipients/two_meshes.usdc", FAULTS / "test.key"
    verify = f"{MESHMARK} verify {source} --key {key} --scheme cho2007 --json"
    assert shell(f"{verify} > /dev/null", FAULTS)[0] == 1
    full, said = shell(f"{verify} > /dev/full", FAULTS)
    assert full == 3
    assert said.endswith("error: stdout: cannot be written: No space left on device\n")
    gone, said = shell(f"{verify} | true; exit ${{PIPESTATUS[0]}}", FAULTS)
    assert gone == 141
    assert "Traceback" not in said


@pytest.mark.slow
def test_the_verdict_stands_whoever_hears_of_it(tmp_path) -> None:
    """Exit code 3 of a missing source, with stderr full or closed, or both streams missing."""
    for streams in ("2> /dev/full", "2>&-", ">&- 2>&-", "2> /dev/full > /dev/full"):
        code, said = shell(f"{MESHMARK} keygen k; {MESHMARK} inspect no.usda {streams}", tmp_path)
        assert code == 3, streams
        assert "Traceback" not in said
