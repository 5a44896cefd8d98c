"""What folders, patterns and lists name."""

from __future__ import annotations

from pathlib import Path

import pytest

from meshmark.errors import InputError
from meshmark.sources.listing import listed

FILES = (
    "a/x.usd",
    "a/y.glb",
    "a/notes.txt",
    "a/walk/w_1.obj",
    "a/walk/w_2.obj",
    "a/walk/still.usda",
    "a/walk/deep/z.usdz",
    "a/.hidden/x.usd",
    "b/run/r_1.obj",
    "b/[1].usd",
    "@at.usd",
)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    for name in FILES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("words", "sources"),
    [
        # A folder of frames is one source; what else is in it are others.
        (["a"], ["a/walk", "a/walk/deep/z.usdz", "a/walk/still.usda", "a/x.usd", "a/y.glb"]),
        (["b/run"], ["b/run"]),
        (["a/walk/w_1.obj"], ["a/walk/w_1.obj"]),
        # As before: frames that a pattern matches are one source. Each folder's, if it has `**`.
        (["a/walk/*.obj"], ["a/walk/*.obj"]),
        (["*/*/*.obj"], ["*/*/*.obj"]),
        (["**/*.obj"], ["a/walk/*.obj", "b/run/*.obj"]),
        (["*/*.usd"], ["a/x.usd", "b/[1].usd"]),
        (
            ["**/*.us*"],
            ["@at.usd", "a/walk/deep/z.usdz", "a/walk/still.usda", "a/x.usd", "b/[1].usd"],
        ),
        (["a/w*"], ["a/walk", "a/walk/deep/z.usdz", "a/walk/still.usda"]),
        (["a/.hidden/*.usd"], ["a/.hidden/x.usd"]),
        # A file that is there is no pattern.
        (["b/[1].usd"], ["b/[1].usd"]),
        (["@@at.usd"], ["@at.usd"]),
        # The order is that of the words; whatever is named again has its place.
        (["b/[1].usd", "a/x.usd", "./a/../a/x.usd", "*/x.usd"], ["b/[1].usd", "a/x.usd"]),
        # Its reader tells that it is missing.
        (["none.usd"], ["none.usd"]),
    ],
)
def test_words_name_sources(words, sources) -> None:
    assert listed(words) == sources


def test_absolute_patterns_match(folder) -> None:
    assert listed([f"{folder}/**/*.glb"]) == [f"{folder}/a/y.glb"]


@pytest.mark.parametrize("end", ["\n", "\r\n", ""])
def test_lists_name_a_source_a_line(end) -> None:
    lines = ["# of last night", "", "@at.usd", "b", "a/x.usd", "*/y.glb", "a/x.usd"]
    Path("list").write_bytes(b"\xef\xbb\xbf" + ((end or "\n").join(lines) + end).encode())
    assert listed(["@list"]) == ["@at.usd", "b/[1].usd", "b/run", "a/x.usd", "a/y.glb"]


def test_long_lists_are_read() -> None:
    names = [f"shot_{i}.usd" for i in range(20_000)]
    Path("list").write_text("\n".join(names))
    assert listed(["@list"]) == names


def test_links_are_followed_once(folder) -> None:
    (folder / "a" / "loop").symlink_to("..")
    (folder / "c").symlink_to("a")
    (folder / "itself").symlink_to("itself")
    own = listed(["a"])
    assert own[:2] == ["a/loop/@at.usd", "a/loop/b/[1].usd"]
    assert len(own) == len({Path(each).resolve() for each in own}) == 8
    # Named again, through a link.
    assert listed(["a", "c", "c/x.usd"]) == own


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("empty", "empty: holds nothing that can be read"),
        ("a/*.txt", "a/*.txt: matches nothing that can be read"),
        ("*.zip", "*.zip: matches nothing that can be read"),
        ("@none", "none: cannot be read: No such file or directory"),
        ("@a", "a: is not a file"),
        ("@blank", "blank: names no source"),
    ],
)
def test_nothing_is_an_error(folder, word, said) -> None:
    (folder / "empty").mkdir()
    (folder / "blank").write_text("# nobody\n\n")
    with pytest.raises(InputError) as raised:
        listed([word])
    assert str(raised.value) == said
