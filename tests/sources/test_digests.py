"""What tells that a file is as it was."""

from __future__ import annotations

import os
import sys
import time

import pytest

from meshmark.sources import digests
from meshmark.sources.digests import stamps_of


@pytest.mark.skipif(sys.platform == "win32", reason="no file tells when it was changed there")
def test_stamps_tell_of_any_change(tmp_path, monkeypatch) -> None:
    path, other = tmp_path / "a", tmp_path / "b"
    path.write_text("one")
    # Within the moment it could be changed again.
    assert stamps_of([path]) is None
    monkeypatch.setattr(digests, "SETTLED", 0.0)
    before, told = stamps_of([path]), path.stat()
    assert before is not None
    assert stamps_of([path]) == before
    time.sleep(0.05)
    path.write_text("two")
    os.utime(path, ns=(told.st_atime_ns, told.st_mtime_ns))
    changed = stamps_of([path])
    assert changed != before
    other.write_text("two")
    os.utime(other, ns=(told.st_atime_ns, told.st_mtime_ns))
    other.replace(path)
    assert stamps_of([path]) not in (before, changed)
