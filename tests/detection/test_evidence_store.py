from __future__ import annotations

import multiprocessing
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from functools import cache
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from detection.stored_sources import beside_the_original, key, mesh, source
from meshmark.detection import evidence_store
from meshmark.detection.evidence_store import (
    EvidenceStore,
    all_frames_together,
    asset_evidence,
    require_arrow,
    rows,
)
from meshmark.detection.parquet_footer import _Compact, require_plain
from meshmark.detection.verify import judge_all
from meshmark.errors import InputError, OutputError, UsageError

pa = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")


@pytest.fixture
def store(tmp_path) -> EvidenceStore:
    return EvidenceStore(tmp_path / "store")


def test_what_is_added_is_found_and_judged_the_same(store) -> None:
    own = key(0)
    stored = source("leak.usd", [mesh(1, own, "acme", n_frames=3)])
    kept = store.add(stored)
    assert kept.items[0].variants[0].shape[0] == 1
    found = store.find(replace(stored, items=(), notes=(), path="/elsewhere"))
    assert found is not None
    assert (found.path, found.version, found.notes) == ("/shots/leak.usd", "1", ("a note",))
    verdicts = [judge_all(asset_evidence(each), own, recipients=["acme"]) for each in (kept, found)]
    assert verdicts[0].recipient == verdicts[1].recipient == "acme"
    assert verdicts[0].log10_p == verdicts[1].log10_p < -6.0
    apart = judge_all(asset_evidence(stored), own, recipients=["acme"])
    assert verdicts[0].log10_p == pytest.approx(apart.log10_p, abs=0.5)


def test_all_frames_together_say_what_their_mean_says() -> None:
    item = mesh(2, n_frames=5)
    one = all_frames_together(item)
    assert len(one.times) == 1
    for before, after in zip(item.variants, one.variants, strict=True):
        np.testing.assert_allclose(after.pooled, before.pooled, atol=1 / 127)
        np.testing.assert_array_equal(np.sign(after.pooled), np.sign(before.pooled))
        np.testing.assert_array_equal(after.posterior.position, before.posterior.position)
        np.testing.assert_array_equal(after.posterior.p_null, before.posterior.p_null)
    assert all_frames_together(one) is one


@pytest.mark.parametrize(
    "change",
    [
        lambda s: replace(s, files=(("leak.usd", "1" * 64),)),
        lambda s: replace(s, original=(("o", "1" * 64),)),
        lambda s: replace(s, frames="1:3"),
        lambda s: replace(s, recipes=[{"scheme": {"name": "apex", "version": "9"}}]),
        lambda s: replace(s, parameters={"clip": "Turn"}),
    ],
)
def test_evidence_of_other_bytes_or_by_other_means_is_not_found(store, change) -> None:
    stored = source("leak.usd", [mesh(1)])
    store.add(stored)
    assert store.find(stored) is not None
    assert store.find(change(stored)) is None


def test_a_source_is_kept_once_under_whatever_name(store) -> None:
    stored = source("leak.usd", [mesh(1)])
    store.add(stored)
    store.add(replace(stored, path="/copies/leak.usd", files=(("b.usd", stored.files[0][1]),)))
    store.add(source("other.usd", [mesh(1)]))
    assert len(store.paths()) == 2


def test_columns_can_be_read_by_anybody(store) -> None:
    store.add(source("leak.usd", [mesh(1), mesh(2, prim="/B"), beside_the_original(3)]))
    [row] = parquet.read_table(store.folder).to_pylist()
    assert row.pop("evidence").startswith(b"meshmark-evidence-4\n")
    assert row["path"] == "/shots/leak.usd"
    assert (row["meshes"], row["informed"], row["frames"], row["version"]) == (2, True, ":", "1")


def add(folder: Path, first: int) -> None:
    store = EvidenceStore(folder)
    for n in range(first, first + 12):
        store.add(source(f"{n}.usd", [mesh(n)]))


def test_many_add_at_once(store) -> None:
    with ThreadPoolExecutor(4) as threads:
        list(threads.map(lambda first: add(store.folder, first), [0, 6, 12, 0]))
    assert [len(list(rows(path))) for path in store.paths()] == [1] * 24


@pytest.mark.slow
def test_many_processes_add_at_once_and_nobody_sees_half_a_file(store) -> None:
    add(store.folder, 0)  # makes the secret, too
    context = multiprocessing.get_context("spawn")
    # Half of the sources are added by two of them.
    writers = [context.Process(target=add, args=(store.folder, 6 * n)) for n in range(3)]
    for writer in writers:
        writer.start()
    while any(writer.is_alive() for writer in writers):
        for path in store.paths():
            assert [row.load().notes for row in rows(path)] == [("a note",)]
    assert [writer.exitcode for writer in writers] == [0, 0, 0]
    assert len(store.paths()) == 24
    assert {path.suffix for path in store.folder.iterdir()} == {".parquet"}


def test_a_forged_or_altered_row_is_refused_unless_asked_for(store, tmp_path, monkeypatch) -> None:
    stored = source("leak.usd", [mesh(1)])
    store.add(stored)
    [path] = store.paths()
    monkeypatch.setenv("MESHMARK_EVIDENCE_SECRET", str(tmp_path / "another"))
    EvidenceStore(tmp_path / "foreign").add(stored)
    monkeypatch.undo()
    [foreign] = EvidenceStore(tmp_path / "foreign").paths()
    path.write_bytes(foreign.read_bytes())
    [row] = rows(path)
    with pytest.raises(InputError, match=r"row 1: is not authentic"):
        row.load()
    assert row.load(authenticated=False).notes == ("a note",)
    assert store.find(stored) is None
    store.add(stored)
    assert store.find(stored) is not None


def test_files_that_were_merged_are_read_row_by_row(store) -> None:
    for n in range(5):
        store.add(source(f"{n}.usd", [mesh(n)]))
    table = parquet.read_table(store.folder)
    merged = store.folder / "merged.parquet"
    parquet.write_table(table, merged, row_group_size=2, compression="none", use_dictionary=False)
    found = [row.load().path for row in rows(merged)]
    assert sorted(found) == [f"/shots/{n}.usd" for n in range(5)]


def written(columns: dict[str, object], **options: object) -> bytes:
    data = BytesIO()
    options = {"compression": "none", "use_dictionary": False, **options}
    parquet.write_table(pa.table(columns), data, **options)
    return data.getvalue()


@cache
def hostile_files() -> dict[str, bytes]:
    one = pa.array([b"x" * 100], pa.binary())
    whole = written({"evidence": one})
    # The column is optional, and says how often it is missing. pyarrow 26 aborts if it is not.
    optional, required = b"\x25\x02\x18\x08evidence", b"\x25\x00\x18\x08evidence"
    assert whole.count(optional) == 1
    return {
        "levels that the schema contradicts": whole.replace(optional, required),
        "text": written({"evidence": pa.array(["x" * 100])}),
        "empty": b"",
        "no parquet": b"PAR1 and then nothing PAR1",
        "cut short": whole[: len(whole) // 2],
        "footer longer than the file": whole[:-8] + b"\xff\xff\xff\x7fPAR1",
        "other columns": written({"other": one}),
        "numbers": written({"evidence": pa.array([1, 2])}),
        "lists": written({"evidence": pa.array([[b"x"]], pa.list_(pa.binary()))}),
        "compressed": written({"evidence": pa.array([bytes(1 << 24)])}, compression="zstd"),
        "one value many times": written(
            {"evidence": pa.array([bytes(1 << 16)] * 100)}, use_dictionary=True
        ),
        "nothing many times": written({"evidence": pa.nulls(10_000_000, pa.binary())}),
    }


@pytest.mark.parametrize("name", hostile_files())
def test_hostile_files_are_refused_in_one_line(tmp_path, name) -> None:
    path = tmp_path / "x.parquet"
    path.write_bytes(hostile_files()[name])
    with pytest.raises(InputError, match=r"x\.parquet: is not a file of a store") as refused:
        list(rows(path))
    assert "\n" not in str(refused.value)


def test_a_footer_is_read_as_the_library_reads_it(store) -> None:
    store.add(source("leak.usd", [mesh(1)]))
    data = store.paths()[0].read_bytes()
    require_plain(BytesIO(data), len(data))
    length = int.from_bytes(data[-8:-4], "little")
    told, footer = parquet.ParquetFile(BytesIO(data)), _Compact(data[-8 - length : -8]).struct()
    root, *columns = footer[2]
    assert [column[4].decode() for column in columns] == told.schema.names
    assert (footer[3], root[5]) == (told.metadata.num_rows, told.metadata.num_columns)
    for n, chunk in enumerate(footer[4][0][1]):
        expected = told.metadata.row_group(0).column(n)
        assert chunk[3][6] == expected.total_uncompressed_size
        assert chunk[3][9] == expected.data_page_offset
    for cut in range(length):
        with pytest.raises(ValueError, match="too "):
            _Compact(data[-8 - length : -8 - length + cut]).struct()


@pytest.mark.parametrize("seed", range(4))
def test_flipped_bytes_are_never_believed(store, tmp_path, seed) -> None:
    store.add(source("leak.usd", [mesh(1)]))
    data = bytearray(store.paths()[0].read_bytes())
    rng = np.random.default_rng(seed)
    for at in rng.integers(0, len(data), size=3):
        data[at] ^= 1 << rng.integers(8)
    path = tmp_path / "x.parquet"
    path.write_bytes(data)
    with suppress(InputError):
        # Other columns may say anything.
        assert [row.load().path for row in rows(path)] in ([], ["/shots/leak.usd"])
    data = bytearray(store.paths()[0].read_bytes())
    data[data.index(b"meshmark-evidence-4\n") + 20 + rng.integers(1000)] ^= 1 << rng.integers(8)
    path.write_bytes(data)
    with pytest.raises(InputError):
        [row.load() for row in rows(path)]


def test_what_cannot_be_read_or_written_is_told_in_one_line(store, tmp_path) -> None:
    with pytest.raises(InputError, match="store: cannot be read"):
        store.paths()
    store.folder.write_text("a file")
    with pytest.raises(OutputError, match="store: cannot be made"):
        store.add(source("leak.usd", [mesh(1)]))
    (tmp_path / "x.parquet").mkdir()
    with pytest.raises(InputError, match="is not a file"):
        list(rows(tmp_path / "x.parquet"))


def test_what_is_missing_is_told(monkeypatch) -> None:
    monkeypatch.setattr(evidence_store, "find_spec", lambda name: None)
    with pytest.raises(UsageError, match=r"pip install 'meshmark\[arrow\]'"):
        require_arrow()
