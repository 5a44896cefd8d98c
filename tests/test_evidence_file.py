from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from meshmark.errors import InputError
from meshmark.evidence import Evidence
from meshmark.evidence_file import FORMAT, StoredEvidence, load_evidence, save_evidence
from meshmark.placement import Placement
from meshmark.strand import Strand


def placements(n_readings, n_carriers) -> tuple[Placement, ...]:
    rng = np.random.default_rng(1)
    places = rng.uniform(0, 7, size=(2, n_readings, n_carriers))
    places[1, :, 0] = np.nan
    return tuple(map(Placement, places, rng.uniform(0.1, 0.9, size=(2, n_carriers))))


@pytest.fixture
def stored() -> StoredEvidence:
    soft = np.random.default_rng(0).uniform(-1, 1, size=(2, 3, 4, 5))
    strands = (
        Strand.of(soft, np.log([0.5, 0.3, 0.2]), 0, float(np.log(0.5))),
        Strand.of(
            soft[:, :, :2], np.log([0.5, 0.3, 0.2]), 10, float(np.log(0.5)), placements(3, 2)
        ),
    )
    item = Evidence("/A", "apex", 8, np.array([1.0, 2.5]), strands, tracked=False, decisive=0.25)
    files = (("a.usd", "0" * 64),)
    return StoredEvidence(files, [{"scheme": {"name": "apex"}}], "1:3", (item,), ("a note",))


def assert_same_frames(one: Strand, two: Strand) -> None:
    for left, right in zip(one.frames, two.frames, strict=True):
        np.testing.assert_array_equal(left.steps, right.steps)
        assert (left.placement is None) == (right.placement is None)
        if left.placement is not None:
            np.testing.assert_array_equal(left.placement.place, right.placement.place)
            np.testing.assert_array_equal(left.placement.doubt, right.placement.doubt)


def test_what_is_saved_is_loaded(stored, tmp_path) -> None:
    save_evidence(stored, tmp_path / "e")
    loaded = load_evidence(tmp_path / "e")
    assert (loaded.files, loaded.frames, loaded.notes) == (stored.files, "1:3", ("a note",))
    assert loaded.recipes == stored.recipes
    [old], [new] = stored.items, loaded.items
    assert (new.prim, new.scheme, new.n_words, new.tracked) == ("/A", "apex", 8, False)
    assert new.decisive == 0.25
    np.testing.assert_array_equal(new.times, old.times)
    for before, after in zip(old.strands, new.strands, strict=True):
        assert (after.restored, after.log_belief) == (before.restored, before.log_belief)
        np.testing.assert_array_equal(after.log_prior, before.log_prior)
        assert_same_frames(after, before)


def test_the_same_evidence_gives_the_same_bytes(stored, tmp_path) -> None:
    for name in ("one", "two"):
        save_evidence(stored, tmp_path / name)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


@pytest.mark.parametrize("keep", [0, 10, 200, -30])
def test_a_torn_file_is_refused(stored, tmp_path, keep) -> None:
    save_evidence(stored, tmp_path / "e")
    (tmp_path / "torn").write_bytes((tmp_path / "e").read_bytes()[:keep])
    with pytest.raises(InputError, match="evidence"):
        load_evidence(tmp_path / "torn")


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_a_changed_bit_is_refused_or_changes_nothing(stored, tmp_path, place, bit) -> None:
    save_evidence(stored, tmp_path / "e")
    data = bytearray((tmp_path / "e").read_bytes())
    data[int(place * len(data))] ^= 1 << bit
    (tmp_path / "changed").write_bytes(data)
    try:
        loaded = load_evidence(tmp_path / "changed")
    except InputError:
        return
    # Names and dates of a zip file's entries stand there twice, and only one is read.
    assert (loaded.files, loaded.recipes, loaded.frames) == (
        stored.files,
        stored.recipes,
        stored.frames,
    )
    for before, after in zip(stored.items[0].strands, loaded.items[0].strands, strict=True):
        np.testing.assert_array_equal(after.log_prior, before.log_prior)
        assert_same_frames(after, before)


def test_another_format_is_named(tmp_path) -> None:
    with (tmp_path / "e").open("wb") as file:
        np.savez(file, header=np.array(json.dumps({"format": "meshmark-evidence-1"})))
    with pytest.raises(InputError, match=FORMAT):
        load_evidence(tmp_path / "e")


def rewritten(path, target, change) -> None:
    """Write an evidence file anew, with some of its arrays changed."""
    with np.load(path) as file:
        arrays = dict(file)
    with target.open("wb") as file:
        np.savez(file, **{**arrays, **change(arrays)})


@pytest.mark.parametrize(
    "change",
    [
        lambda a: {"steps0.0": a["steps0.0"].astype(np.int16)},
        lambda a: {"steps0.0": a["steps0.0"][0]},
        lambda a: {"steps0.0": a["steps0.0"][:1]},
        lambda a: {"steps0.0": a["steps0.0"][:0], "times0": a["times0"][:0]},
        lambda a: {"steps0.0": np.asfortranarray(a["steps0.0"])},
        lambda a: {"prior0.0": a["prior0.0"][:2]},
        lambda a: {"prior0.0": a["prior0.0"] + 1.0},
        lambda a: {"prior0.0": a["prior0.0"] * np.nan},
        lambda a: {"place0.1": a["place0.1"][:1]},
        lambda a: {"place0.1": a["place0.1"][:, :1]},
        lambda a: {"place0.1": a["place0.1"] + 1e300},
        lambda a: {"doubt0.1": np.zeros_like(a["doubt0.1"])},
        lambda a: {"doubt0.1": a["doubt0.1"][..., None]},
    ],
)
def test_arrays_that_do_not_belong_together_are_refused(stored, tmp_path, change) -> None:
    save_evidence(stored, tmp_path / "e")
    rewritten(tmp_path / "e", tmp_path / "same", lambda arrays: {})
    load_evidence(tmp_path / "same")
    rewritten(tmp_path / "e", tmp_path / "changed", change)
    with pytest.raises(InputError, match="evidence"):
        load_evidence(tmp_path / "changed")


def test_arrays_of_somebody_elses_are_refused(tmp_path) -> None:
    with (tmp_path / "e").open("wb") as file:
        np.savez(file, header=np.array("{}"))
    with pytest.raises(InputError, match="evidence"):
        load_evidence(tmp_path / "e")


def test_a_missing_file_is_named(tmp_path) -> None:
    with pytest.raises(InputError, match=r"nothing\.here"):
        load_evidence(tmp_path / "nothing.here")
