"""Freed memory goes back to the system."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

# Pieces too small to be mapped one by one, of which the last stays.
PROGRAM = """
import os
from pathlib import Path
from meshmark.workers.memory import give_back_memory

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

pieces = [bytearray(b"x" * 60_000) for _ in range(2_000)]
last = pieces.pop()
full = resident()
pieces.clear()
freed = resident()
give_back_memory()
print(full - freed, full - resident())
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="others do without")
def test_what_was_freed_is_given_back() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True)
    kept, given = map(int, done.stdout.split())
    assert kept < 20_000_000
    assert given > 100_000_000
