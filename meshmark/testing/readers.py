"""What every reader must do; subclass `ReaderSuite` in your own tests to check yours.

class TestMyReader(ReaderSuite):
@pytest.fixture
def record(self):
return my_plugin.RECORD

@pytest.fixture
def source(self, tmp_path):
return write_a_small_file(tmp_path)
"""

from __future__ import annotations

import contextlib
import pickle
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from meshmark.errors import InputError, OutputError
from meshmark.extension.hookspecs import Reader, ReaderRecord
from meshmark.mesh.animation import Frame
from meshmark.mesh.asset import Asset


class ReaderSuite:
    """Checks the contract of one reader; override `record` and `source`, and what else differs."""

    @pytest.fixture
    def record(self) -> ReaderRecord:
        """Offer the reader under test."""
        raise NotImplementedError("override the fixture `record`")

    @pytest.fixture
    def source(self) -> str:
        """Offer something the reader reads, ideally of several frames."""
        raise NotImplementedError("override the fixture `source`")

    @pytest.fixture
    def broken_source(self) -> str | None:
        """Offer something the reader accepts by name, but whose content is nonsense; or None."""
        return None

    @pytest.fixture
    def output(self, tmp_path: Path) -> Path | None:
        """Offer a place the reader can write a copy of the source to; None if it cannot write."""
        return None

    @pytest.fixture
    def reader(self, record: ReaderRecord) -> Reader:
        """Build the reader."""
        return record.factory(**record.parameters)

    @pytest.fixture
    def asset(self, reader: Reader, source: str) -> Asset:
        """Read the source."""
        return reader.read(source)

    def test_record_is_complete(self, record: ReaderRecord) -> None:
        """A record names its reader, says in one line what it reads, and has a version."""
        assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", record.name)
        assert record.summary.strip()
        assert "\n" not in record.summary
        assert record.version

    def test_accepts_its_own_source_and_not_a_strangers(self, reader: Reader, source: str) -> None:
        """Among several readers exactly one must feel meant."""
        assert isinstance(reader, Reader)
        assert reader.accepts(source)
        assert not reader.accepts("letter.no-such-format")

    def test_asset_says_where_it_is_from(
        self, record: ReaderRecord, asset: Asset, source: str
    ) -> None:
        """Reader, source and prims are named, prims once each."""
        assert asset.reader == record.name
        assert asset.source == source
        assert asset.meshes
        prims = [mesh.prim for mesh in asset.meshes]
        assert len(set(prims)) == len(prims)
        assert asset.up_axis in ("Y", "Z")
        assert asset.meters_per_unit > 0
        assert asset.fps > 0

    def test_frames_are_sound(self, asset: Asset) -> None:
        """Every frame is finite, at its time, and what is said of the topology holds."""
        for mesh in asset.meshes:
            frames = list(mesh)
            assert len(frames) == len(mesh) >= 1
            times = np.array([frame.time for frame in frames])
            np.testing.assert_array_equal(times, mesh.times)
            for frame in frames:
                assert frame.points.dtype == np.float64
                assert frame.points.shape == (frame.topology.n_points, 3)
                assert np.all(np.isfinite(frame.points))
            same = all(frames[0].topology.same_as(frame.topology) for frame in frames)
            assert same or not mesh.constant_topology

    def test_frames_do_not_depend_on_the_order_they_are_read_in(self, asset: Asset) -> None:
        """Lazy frames are a function of their index."""
        for mesh in asset.meshes:
            backwards = [mesh[index] for index in reversed(range(len(mesh)))]
            assert_same_points(list(mesh), backwards[::-1])

    def test_asset_pickles(self, asset: Asset) -> None:
        """Worker processes read the same frames by themselves."""
        copy = pickle.loads(pickle.dumps(asset))
        for mesh, other in zip(asset.meshes, copy.meshes, strict=True):
            assert_same_points(list(mesh), list(other))

    def test_missing_source_is_named(self, reader: Reader, tmp_path: Path, source: str) -> None:
        """What is not there is an InputError that says so."""
        missing = str(tmp_path / "nowhere" / Path(source).name)
        with pytest.raises(InputError, match="nowhere"):
            reader.read(missing)

    def test_broken_source_is_named(self, reader: Reader, broken_source: str | None) -> None:
        """Nonsense is an InputError that names the file, at the latest when a frame is asked."""
        if broken_source is None:
            pytest.skip("no broken source is offered")
        with pytest.raises(InputError) as caught:
            list(reader.read(broken_source).meshes[0])
        assert str(caught.value.source).startswith(broken_source)

    def test_writes_back_what_was_moved(
        self, reader: Reader, asset: Asset, output: Path | None
    ) -> None:
        """A copy read back has the moved points, to float32, and the same times and polygons."""
        if output is None:
            pytest.skip("this reader does not write")
        assert reader.writes(output)
        moved = replace(asset, meshes=tuple(mesh.map(shifted) for mesh in asset.meshes))
        reader.write(moved, asset, output)
        copy = reader.read(str(output))
        assert [mesh.prim for mesh in copy.meshes] == [mesh.prim for mesh in asset.meshes]
        for mesh, other in zip(moved.meshes, copy.meshes, strict=True):
            np.testing.assert_array_equal(mesh.times, other.times)
            for one, two in zip(mesh, other, strict=True):
                assert one.topology.same_as(two.topology)
                atol = 1e-6 * np.abs(one.points).max()
                np.testing.assert_allclose(two.points, one.points, rtol=0, atol=atol)

    def test_writing_again_does_no_harm(
        self, reader: Reader, asset: Asset, output: Path | None
    ) -> None:
        """A second writing is refused or gives the same, and neither leaves anything beside."""
        if output is None:
            pytest.skip("this reader does not write")
        beside = set(output.parent.iterdir())
        reader.write(asset, asset, output)
        before = contents(output)
        with contextlib.suppress(OutputError):
            reader.write(asset, asset, output)
        assert contents(output) == before
        assert set(output.parent.iterdir()) == beside | {output}


def shifted(frame: Frame) -> Frame:
    """Move the even vertices of a frame by a thousandth of its size."""
    points = frame.points.copy()
    points[::2] += 1e-3 * np.ptp(points, axis=0).max()
    return frame.moved(points)


def contents(place: Path) -> dict[str, bytes]:
    """Read a file, or every file below a folder."""
    files = [place] if place.is_file() else [p for p in place.rglob("*") if p.is_file()]
    return {str(path): path.read_bytes() for path in files}


def assert_same_points(one: list[Frame], two: list[Frame]) -> None:
    """Fail unless both hold the same points and polygons, bit for bit."""
    assert len(one) == len(two)
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a.points, b.points)
        assert a.topology.same_as(b.topology)
