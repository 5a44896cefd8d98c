"""How a source is found its reader, and what is asked of a reader that says only the least."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from meshmark import UsageError, read, write
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.sources import readers
from meshmark.sources.facts import files_in_reach, source_files, texture_coordinates
from meshmark.sources.readers import PluginReader, find_reader, reader_called
from meshmark.sources.writing import read_back, writer, written_names
from meshmark.testing.meshes import icosphere
from meshmark.usd.reader import UsdReader
from meshmark_plugins.readers.obj import ObjFrames
from usd_stages import CUBE_POINTS, cube, moved, write_text

V, F = icosphere(1)
UV = np.zeros((len(F), 3, 2))


def mesh(prim: str, size: float = 1.0) -> MeshAnimation:
    return MeshAnimation.from_arrays(size * V[None], F, prim=prim)


class Least:
    """Reads "NAME.least", a source of two meshes whose names are no prim paths."""

    def __init__(self) -> None:
        self.wrote: Asset | None = None

    def accepts(self, source: str) -> bool:
        return source.endswith(".least")

    def read(self, source: str) -> Asset:
        return Asset(source, (mesh("left arm"), mesh("left_arm", 2.0)), "least")

    def writes(self, output: Path) -> bool:
        return output.suffix == ".least"

    def write(self, marked: Asset, original: Asset, output: Path) -> None:
        self.wrote = marked


class Talkative(Least):
    """Tells all that a reader can."""

    def files(self, source: str) -> list[Path]:
        return [Path(source), Path(f"{source}.buffer")]

    def files_in_reach(self, source: str) -> list[Path]:
        return [*self.files(source), Path("texture.png")]

    def texture_coordinates(self, source: str, prim: str) -> np.ndarray | None:
        return UV if prim == "left arm" else None


@pytest.fixture
def source(tmp_path: Path) -> str:
    (tmp_path / "a.least").touch()
    return str(tmp_path / "a.least")


def install(monkeypatch: pytest.MonkeyPatch, reader: Least) -> None:
    """Let the core find one plugin's reader beside its own."""
    monkeypatch.setattr(readers, "_readers", lambda: iter([UsdReader(), PluginReader(reader)]))
    monkeypatch.setattr(readers, "make_reader", lambda name: reader)


def test_each_source_has_the_reader_it_is_meant_for(tmp_path: Path) -> None:
    (tmp_path / "1.obj").touch()
    for name in ("a.usd", "A.USDA", "b.usdc", "c.usdz"):
        assert isinstance(find_reader(name), UsdReader)
    for name in (tmp_path, tmp_path / "1.obj", tmp_path / "*.obj"):
        found = find_reader(str(name))
        assert isinstance(found, PluginReader)
        assert isinstance(found.reader, ObjFrames)
    assert find_reader("letter.no-such-format") is None
    assert isinstance(reader_called("usd"), UsdReader)
    with pytest.raises(UsageError, match="no reader is called 'memory'"):
        reader_called("memory")


def test_what_a_reader_does_not_tell_is_filled_in(
    source: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(monkeypatch, Least())
    asset = read(source)
    assert source_files(source) == files_in_reach(asset) == [Path(source)]
    assert texture_coordinates(asset, "left arm") is None
    assert [each.prim for each in read(source, ["left_arm"]).meshes] == ["left_arm"]


def test_what_a_reader_tells_is_taken(source: str, monkeypatch: pytest.MonkeyPatch) -> None:
    install(monkeypatch, Talkative())
    asset = read(source)
    own = [Path(source), Path(f"{source}.buffer")]
    assert source_files(source) == own
    assert files_in_reach(asset) == [*own, Path("texture.png")]
    assert texture_coordinates(asset, "left arm") is UV
    assert texture_coordinates(asset, "left_arm") is None


def test_a_reader_writes_all_meshes_whichever_are_marked(
    source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reader = Least()
    install(monkeypatch, reader)
    original = read(source)
    marked = replace(original, meshes=(mesh("left_arm", 3.0),))
    write(marked, original, tmp_path / "o.least")
    assert reader.wrote is not None
    assert [each.prim for each in reader.wrote.meshes] == ["left arm", "left_arm"]
    assert reader.wrote.meshes[1] is marked.meshes[0]
    with pytest.raises(UsageError, match=r"the least reader cannot write to .*\.usda, \.usdc alw"):
        writer(original, tmp_path / "o.obj")
    with pytest.raises(UsageError, match="no mesh at right_arm"):
        write(replace(original, meshes=(mesh("right_arm"),)), original, tmp_path / "o.least")


@pytest.mark.parametrize("deliver", [False, True])
def test_names_that_are_no_prim_paths_come_back(
    source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, deliver: bool
) -> None:
    install(monkeypatch, Least())
    original, output = read(source), tmp_path / "o.usda"
    write(replace(original, meshes=(mesh("left_arm", 3.0),)), original, output, deliver=deliver)
    assert written_names(original, output) == {"left arm": "/left_arm", "left_arm": "/left_arm_2"}
    for prims in (["left_arm"], ["left_arm", "left arm"]):
        back = read_back(original, output, prims)
        assert [each.prim for each in back.meshes] == prims
        np.testing.assert_allclose(back.meshes[0][0].points, 3 * V, rtol=1e-6)


def test_of_a_stage_an_override_has_only_what_is_marked(tmp_path: Path) -> None:
    original = read(write_text(tmp_path / "s.usda", cube("b") + cube("a")))
    (first, _) = moved(original).meshes
    write(replace(original, meshes=(first,)), original, tmp_path / "o.usda")
    assert '"a"' not in (tmp_path / "o.usda").read_text()
    back = read_back(original, tmp_path / "o.usda", ["/a", "/b"])
    assert [each.prim for each in back.meshes] == ["/a", "/b"]
    np.testing.assert_array_equal(back.meshes[0][0].points, CUBE_POINTS)
    with pytest.raises(UsageError, match="the usd reader cannot write to"):
        writer(original, tmp_path / "o.obj")
