from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from meshmark.errors import InputError
from meshmark.evidence import Evidence, Strand
from meshmark.evidence_file import FORMAT, StoredEvidence, load_evidence, save_evidence
from meshmark.placement import Placement


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
        np.testing.assert_array_equal(after.steps, before.steps)
        np.testing.assert_array_equal(after.log_prior, before.log_prior)
        assert (after.placements is None) == (before.placements is None)
        for one, two in zip(before.placements or (), after.placements or (), strict=True):
            np.testing.assert_array_equal(two.place, one.place)
            np.testing.assert_array_equal(two.doubt, one.doubt)


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
        np.testing.assert_array_equal(after.steps, before.steps)
        np.testing.assert_array_equal(after.log_prior, before.log_prior)


def test_another_format_is_named(tmp_path) -> None:
    with (tmp_path / "e").open("wb") as file:
        np.savez(file, header=np.array(json.dumps({"format": "meshmark-evidence-1"})))
    with pytest.raises(InputError, match=FORMAT):
        load_evidence(tmp_path / "e")


def test_steps_of_another_kind_are_refused(stored, tmp_path) -> None:
    [item] = stored.items
    strand = item.strands[0]
    for steps in (strand.steps.astype(np.int16), strand.steps[0]):
        broken = replace(item, strands=(replace(strand, steps=steps),))
        save_evidence(replace(stored, items=(broken,)), tmp_path / "e")
        with pytest.raises(InputError, match="evidence"):
            load_evidence(tmp_path / "e")


def test_placements_that_fit_no_strand_are_refused(stored, tmp_path) -> None:
    [item] = stored.items
    strand = item.strands[1]
    first, second = strand.placements
    sure = Placement(first.place, np.zeros_like(first.doubt))
    astray = Placement(first.place + 1e300, first.doubt)
    for broken in ((first,), (first.under(0), second.under(0)), (sure, second), (astray, second)):
        wrong = replace(item, strands=(replace(strand, placements=broken),))
        save_evidence(replace(stored, items=(wrong,)), tmp_path / "e")
        with pytest.raises(InputError, match="evidence"):
            load_evidence(tmp_path / "e")


def test_arrays_of_somebody_elses_are_refused(tmp_path) -> None:
    with (tmp_path / "e").open("wb") as file:
        np.savez(file, header=np.array("{}"))
    with pytest.raises(InputError, match="evidence"):
        load_evidence(tmp_path / "e")


def test_a_missing_file_is_named(tmp_path) -> None:
    with pytest.raises(InputError, match=r"nothing\.here"):
        load_evidence(tmp_path / "nothing.here")
