"""Recorded paths are found again where their folders were moved to."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from meshmark.errors import UsageError
from meshmark.ledger.marks import mark_of
from meshmark.ledger.moved import Move, moved, moves_of, place
from meshmark.ledger.origins import Origin, origins


@pytest.mark.parametrize(
    ("path", "move", "now"),
    [
        ("/shots/a/b.usdc", "/shots=/mnt/shots", "/mnt/shots/a/b.usdc"),
        ("/shots/a/b.usdc", "/shots/=/mnt/shots/", "/mnt/shots/a/b.usdc"),
        ("/shots/for/../a/b.usdc", "/shots/a=/vault", "/vault/b.usdc"),
        ("/shots/b.usdc", "/shots/b.usdc=/vault/c.usdc", "/vault/c.usdc"),
        ("/b.usdc", "/=/mnt", "/mnt/b.usdc"),
        # A folder, not the beginning of a name; POSIX tells letters apart.
        ("/shots2/b.usdc", "/shots=/mnt", "/shots2/b.usdc"),
        ("/Shots/b.usdc", "/shots=/mnt", "/Shots/b.usdc"),
        (r"P:\Shots\a\b.usdc", r"p:\shots=/mnt/shots", "/mnt/shots/a/b.usdc"),
        (r"P:\Shots\a\b.usdc", "P:/=/mnt", "/mnt/Shots/a/b.usdc"),
        ("P:/shots/b.usdc", "P:=/mnt", "/mnt/shots/b.usdc"),
        (r"\\nas\shots\b.usdc", "//NAS/shots=/mnt", "/mnt/b.usdc"),
        (r"Q:\b.usdc", "P:=/mnt", r"Q:\b.usdc"),
    ],
)
def test_what_was_in_a_folder_is_where_that_is_now(path: str, move: str, now: str) -> None:
    assert place(path, [Move.of(move)]) == Path(now)


def test_the_first_folder_counts() -> None:
    moves = moves_of(["/a/b=/first"], "/a=/second; /c=/third;")
    found = [place(path, moves) for path in ("/a/b/x", "/a/x", "/c/x", "/d/x")]
    assert found == [Path("/first/x"), Path("/second/x"), Path("/third/x"), Path("/d/x")]


@pytest.mark.parametrize("text", ["/a", "=/b", "/a= ", ""])
def test_anything_else_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="given as OLD=NEW"):
        Move.of(text)


def manifest_of(path: str) -> dict[str, Any]:
    return {
        "source": {"path": path, "files": [{"file": path, "sha256": "ab" * 32}]},
        "recipient": None,
        "key_id": "0" * 16,
        "plugins": {},
        "layers": [],
        "prims": [],
    }


def origin_of(output: str, path: str, **entry: Any) -> Origin:
    recorded = {**mark_of(manifest_of(path), Path("/x")), **entry, "output": output}
    [found] = origins([{**recorded, "sequence": 1}])
    return found


def test_originals_and_masters_move() -> None:
    windows = origin_of(r"P:\out\acme.usdc", "../in/a.usdc")
    assert moved(windows, [Move.of(r"P:\in=/vault")]).source == Path("/vault/a.usdc")
    master = {"path": "/masters/a.usdc", "files": []}
    kept = origin_of("/out/acme.usdc", "../in/a.usdc", master=master)
    there = moved(kept, moves_of(["/masters=/vault"], None))
    assert there.source == kept.source
    assert there.master == {"path": "/vault/a.usdc", "files": []}


def test_published_copies_tell_where_their_source_was(tmp_path: Path) -> None:
    staged, published = tmp_path / "stage" / "out" / "a.usdc", tmp_path / "v1" / "a.usdc"
    entry = mark_of(manifest_of("../in/a.usdc"), staged, published=published)
    assert entry["output"] == str(published)
    [found] = origins([{**entry, "sequence": 1}])
    assert found.source == (tmp_path / "stage" / "in" / "a.usdc").resolve()
