"""The hook of Prism: the marked file takes the place of the exported one, or nothing does."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from shots import QUICK, is_marked, key_file, shot, tiny

from meshmark.embedding.manifest import remark
from meshmark.errors import CapacityError
from meshmark_plugins.publish import for_prism


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.setattr(for_prism, "KEY_FILE", key_file(tmp_path))
    monkeypatch.setattr(for_prism, "OPTIONS", QUICK)
    monkeypatch.setattr(for_prism, "RECIPIENT", "acme")
    return tmp_path / "v0001"


def exported(path: Path) -> dict | None:
    """Call the hook as Prism does."""
    more = {"scenefile": "walk.ma", "startframe": 1, "endframe": 3, "state": None}
    return for_prism.main(core=SimpleNamespace(), outputpath=str(path), **more)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_the_marked_file_takes_its_place_and_a_second_call_leaves_it(folder) -> None:
    path = shot(folder / "walk.usdc")
    told = exported(path)
    assert told["marked"]
    assert names(folder) == ["walk.usdc", "walk.usdc.meshmark.json"]
    assert is_marked(path)
    assert remark(path) is None
    before = path.read_bytes()
    assert exported(path) == told
    assert path.read_bytes() == before


def test_what_cannot_be_marked_is_not_where_it_would_be_found(folder) -> None:
    path = tiny(folder / "prop.usdc")
    with pytest.raises(CapacityError, match="cannot hold 64 bits"):
        exported(path)
    assert names(folder) == ["prop.usdc.unmarked"]


def test_whatever_goes_wrong_it_is_not_there(folder, monkeypatch) -> None:
    path = shot(folder / "walk.usdc")
    monkeypatch.setattr("meshmark.embedding.file.embed", None)
    with pytest.raises(TypeError):
        exported(path)
    assert names(folder) == ["walk.usdc.unmarked"]


def test_a_waiver_leaves_it_in_its_place(folder, monkeypatch) -> None:
    monkeypatch.setattr(for_prism, "WAIVERS", {"*/prop*": "placeholders, says Kim"})
    path = tiny(folder / "prop.usdc")
    told = exported(path)
    assert (told["marked"], told["waiver"]) == (False, "placeholders, says Kim")
    assert names(folder) == ["prop.usdc"]


def test_other_files_are_let_be(folder) -> None:
    folder.mkdir()
    path = folder / "shot.nk"
    path.write_text("Root {}")
    assert exported(path) is None
    assert names(folder) == ["shot.nk"]
