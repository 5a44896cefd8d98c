"""Commands for the schedulers of render farms."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from meshmark.commands.farm import verify_commands
from meshmark.errors import UsageError


def test_each_line_has_some_of_the_sources_and_a_file_of_its_own(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    sources = ["a b.usd", "it's.usd", "$(rm x).usd", "/abs/'walk_*.obj", "-o.usd"]
    lines = list(verify_commands(["--key", "/k"], sources, 2, Path("out.jsonl")))
    words = [shlex.split(line) for line in lines]
    assert [each[:4] for each in words] == [["meshmark", "verify", "--key", "/k"]] * 3
    assert [each[4:6] for each in words] == [
        ["--resume", str(tmp_path / f"out.000{number}.jsonl")] for number in (1, 2, 3)
    ]
    assert [name for each in words for name in each[6:]] == [
        str(tmp_path / name) for name in sources
    ]


def test_a_line_break_in_a_name_is_refused() -> None:
    with pytest.raises(UsageError, match="line break"):
        list(verify_commands([], ["a\nb.usd"], 10))
