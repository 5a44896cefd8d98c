"""The file that `verify --resume` goes on with."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from meshmark.commands.answers import answers_kept, as_line
from meshmark.commands.outcome import Outcome, failed
from meshmark.commands.verification import Request
from meshmark.detection.verdict import Verdict
from meshmark.errors import InputError, MeshmarkError, OutputError, TimeLimitError
from meshmark.extension.recipe import Recipe
from meshmark.sources.digests import file_hashes, sha256

FILE = Path("answers.jsonl")


@pytest.fixture
def request_(tmp_path, monkeypatch) -> Request:
    """Stand in an empty folder, and ask for something."""
    monkeypatch.chdir(tmp_path)
    return Request(Path("k"), "0" * 16, [Recipe("relief")], True, ["acme"], recorded=True)


def outcome(source: str, request: Request, code: int = 0) -> Outcome:
    """Answer for a file, or a folder of files."""
    path = Path(source)
    files = sorted(path.iterdir()) if path.is_dir() else sorted(path.parent.glob(path.name))
    pairs = [(str(file.resolve()), sha256(file)) for file in files]
    hashed = file_hashes(pairs, path.parent.resolve())
    verdict = None if code else Verdict.of_nothing(source)
    return Outcome(source, verdict, "bad" if code else "", code, hashed, request.asked(source))


def write(*outcomes: Outcome, path: Path = FILE) -> None:
    path.write_text("".join(f"{as_line(each)}\n" for each in outcomes))


def known(request: Request, *sources: str) -> list[str]:
    with answers_kept(FILE) as kept:
        return sorted(kept.known(sources, request))


def test_what_is_answered_is_left_out(request_) -> None:
    for name in "abc":
        Path(f"{name}.usd").write_text(name)
    write(outcome("a.usd", request_), outcome("b.usd", request_, 3))
    assert known(request_, "a.usd", "b.usd", "c.usd") == ["a.usd", "b.usd"]


def test_what_is_answered_of_something_else_is_not(request_) -> None:
    for name in "abc":
        Path(f"{name}.usd").write_text(name)
    write(*(outcome(f"{name}.usd", request_) for name in "abc"))
    Path("b.usd").write_text("another file")
    Path("c.usd").unlink()
    assert known(request_, "a.usd", "b.usd", "c.usd") == ["a.usd"]
    for changes in (
        {"key_id": "1" * 16},
        {"recipes": [Recipe("apex")]},
        {"recipes": [Recipe("relief", settings={"relief": {"slope": 0.3}})]},
        {"recipients": ["acme", "globex"]},
        {"frames": "1:4"},
        {"fpr": 1e-5},
        {"parameters": {"clip": "walk"}},
        {"beside": {"original": [{"file": "o.usd", "sha256": "0" * 64}]}},
    ):
        assert known(replace(request_, **changes), "a.usd") == []


def test_what_took_too_long_is_tried_again_with_more_time(request_) -> None:
    Path("a.usd").write_text("a")
    limited = replace(request_, timeout=60.0)
    late = failed("a.usd", TimeLimitError("takes longer than 60 s"), limited)
    assert (late.exit_code, late.error) == (3, "a.usd: takes longer than 60 s")
    assert [each["file"] for each in late.files] == ["a.usd"]
    write(late)
    for timeout, left_out in ((30.0, ["a.usd"]), (60.0, ["a.usd"]), (61.0, []), (None, [])):
        assert known(replace(request_, timeout=timeout), "a.usd") == left_out
    # A verdict stands, however long it may take now.
    write(outcome("a.usd", limited))
    assert known(request_, "a.usd") == ["a.usd"]


def test_a_manifest_that_names_other_schemes_changes_what_is_asked(request_) -> None:
    Path("a.usd").write_text("a")
    anything = replace(request_, named=False)
    write(outcome("a.usd", anything))
    assert known(anything, "a.usd") == ["a.usd"]
    Path("a.usd.meshmark.json").write_text(json.dumps({"layers": [{"name": "cho2007"}]}))
    assert known(anything, "a.usd") == []


def test_a_folder_with_another_frame_is_another_source(request_) -> None:
    Path("walk").mkdir()
    Path("walk/1.obj").write_text("1")
    both = ("walk", "walk/*.obj")
    write(outcome("walk", request_), outcome("walk/*.obj", request_, 3))
    assert known(request_, *both) == list(both)
    Path("walk/2.obj").write_text("2")
    assert known(request_, *both) == []


def test_folders_may_be_moved_and_twins_have_an_answer_each(request_) -> None:
    for folder in ("old", "new", "twin"):
        Path(folder).mkdir()
        Path(folder, "a.usd").write_text("a")
    write(outcome("old/a.usd", request_))
    assert known(request_, "new/a.usd") == ["new/a.usd"]
    assert known(request_, "new/a.usd", "twin/a.usd") == ["new/a.usd"]
    assert known(request_, "new/a.usd", "old/a.usd") == ["old/a.usd"]


def test_what_was_missing_is_tried_again_once_it_is_there(request_) -> None:
    write(outcome("a.usd", request_, 3))
    assert known(request_, "a.usd") == ["a.usd"]
    Path("a.usd").write_text("a")
    assert known(request_, "a.usd") == []


def test_a_line_that_was_cut_short_is_removed(request_) -> None:
    for name in "ab":
        Path(f"{name}.usd").write_text(name)
    write(outcome("a.usd", request_), outcome("b.usd", request_))
    whole = FILE.read_bytes()
    first = whole.index(b"\n") + 1
    for end in (first + 1, first + 5, len(whole) - 200, len(whole) - 1):
        FILE.write_bytes(whole[:end])
        assert known(request_, "a.usd", "b.usd") == ["a.usd"]
        assert FILE.read_bytes() == whole[:first]


@pytest.mark.parametrize("code", [5, 70])
def test_what_was_not_the_files_fault_is_tried_again(request_, code) -> None:
    for name in "abc":
        Path(f"{name}.usd").write_text(name)
    kept = [outcome("a.usd", request_), outcome("c.usd", request_, 3)]
    write(kept[0], outcome("b.usd", request_, code), kept[1])
    with FILE.open("ab") as file:
        file.write(b'{"sou')
    assert known(request_, "a.usd", "b.usd", "c.usd") == ["a.usd", "c.usd"]
    assert FILE.read_text() == "".join(f"{as_line(each)}\n" for each in kept)


@pytest.mark.parametrize(
    "content",
    ["hello\n", "hello", "[]\n", "1\n", '{"source": "a"}\n', '{"source": 1, "files": []', "\0" * 9],
)
def test_other_files_are_refused_and_left_alone(request_, content) -> None:
    FILE.write_text(content)
    with pytest.raises(InputError, match=r"answers.jsonl: line 1 is no answer"):
        known(request_, "a.usd")
    assert FILE.read_text() == content


def test_two_runs_do_not_share_a_file(request_) -> None:
    with answers_kept(FILE) as kept:
        with pytest.raises(OutputError, match="is being written by another run"):
            known(request_)
        kept.append("{}")
    assert FILE.read_text() == "{}\n"


@pytest.mark.parametrize("place", ["none/answers.jsonl", "folder", "pipe"])
def test_places_that_cannot_be_written_to_are_told_of_at_once(request_, place) -> None:
    import os

    Path("folder").mkdir()
    os.mkfifo("pipe")
    with pytest.raises(MeshmarkError) as raised, answers_kept(Path(place)):
        pass
    assert raised.value.exit_code == 3
    assert place in str(raised.value)


def test_on_a_full_disk_nothing_half_written_is_left(request_, monkeypatch) -> None:
    Path("a.usd").write_text("a")
    write(outcome("a.usd", request_))
    before = FILE.read_bytes()
    with answers_kept(FILE) as kept:
        written: list[int] = []

        class Full:
            """A disk with room for ten more bytes."""

            def write(self, data: bytes) -> int:
                if written:
                    raise OSError(28, "No space left on device")
                with FILE.open("ab") as file:
                    written.append(file.write(data[:10]))
                return 10

        monkeypatch.setattr(kept, "_file", Full())
        with pytest.raises(OutputError, match="No space left on device"):
            kept.append("x" * 100)
    assert written
    assert FILE.read_bytes() == before
