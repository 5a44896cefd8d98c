from __future__ import annotations

import gzip
import hmac
import json
import os
import struct
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from meshmark.detection.evidence import Evidence, RestoredVariant
from meshmark.detection.evidence_file import KIND, StoredEvidence, load_evidence, save_evidence
from meshmark.detection.evidence_header import EXPANSION, FRAMES, LONGEST
from meshmark.detection.gathering import AssetEvidence
from meshmark.detection.original_layout import OriginalLayout
from meshmark.detection.verify import judge_all
from meshmark.detection.vertex_evidence import VertexEvidence
from meshmark.errors import InputError, OutputError
from meshmark.extension.informed import MOST_VERTICES
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key
from meshmark.statistics.word_windows import WordPosterior
from meshmark.testing.informed_schemes import horned

KEY = Key(bytes(range(32)))


def posteriors(n_readings, n_carriers) -> tuple[WordPosterior, ...]:
    rng = np.random.default_rng(1)
    places = rng.uniform(0, 7, size=(2, n_readings, n_carriers))
    places[1, :, 0] = np.nan
    return tuple(map(WordPosterior, places, rng.uniform(0.1, 0.9, size=(2, n_carriers))))


@pytest.fixture
def stored() -> StoredEvidence:
    soft = np.random.default_rng(0).uniform(-1, 1, size=(2, 3, 4, 5))
    variants = (
        RestoredVariant.of(soft, np.log([0.5, 0.3, 0.2]), 0, float(np.log(0.5)), posteriors(3, 4)),
        RestoredVariant.of(
            soft[:, :, :2], np.log([0.5, 0.3, 0.2]), 10, float(np.log(0.5)), posteriors(3, 2)
        ),
    )
    item = Evidence(
        "/A", "apex", 8, np.array([1.0, 2.5]), variants, tracked=False, bit_threshold=0.25
    )
    files = (("a.usd", "0" * 64),)
    return StoredEvidence(files, (), ({"scheme": {"name": "apex"}},), "1:3", (item,), ("a note",))


def assert_same_frames(one: RestoredVariant, two: RestoredVariant) -> None:
    for left, right in zip(one.frames, two.frames, strict=True):
        np.testing.assert_array_equal(left.steps, right.steps)
        assert (left.posterior is None) == (right.posterior is None)
        if left.posterior is not None:
            np.testing.assert_array_equal(left.posterior.position, right.posterior.position)
            np.testing.assert_array_equal(left.posterior.p_null, right.posterior.p_null)


def test_what_is_saved_is_loaded(stored, tmp_path) -> None:
    save_evidence(stored, tmp_path / "e")
    loaded = load_evidence(tmp_path / "e")
    assert (loaded.files, loaded.frames, loaded.notes) == (stored.files, "1:3", ("a note",))
    assert loaded.recipes == stored.recipes
    [old], [new] = stored.items, loaded.items
    assert (new.prim, new.scheme, new.n_words, new.tracked) == ("/A", "apex", 8, False)
    assert new.bit_threshold == 0.25
    np.testing.assert_array_equal(new.times, old.times)
    for before, after in zip(old.variants, new.variants, strict=True):
        assert (after.restored, after.log_belief) == (before.restored, before.log_belief)
        np.testing.assert_array_equal(after.log_prior, before.log_prior)
        assert_same_frames(after, before)


def test_what_vertices_tell_is_saved_and_loaded_without_the_original(stored, tmp_path) -> None:
    steps = np.array([-(2**15), -7, 0, 2**15 - 1], dtype=np.int16)
    on = OriginalLayout(horned(), Recipe("relief").build())
    item = replace(stored.items[0], vertices=VertexEvidence(steps, on))
    save_evidence(replace(stored, items=(item, stored.items[0])), tmp_path / "e")
    told, untold = (each.vertices for each in load_evidence(tmp_path / "e").items)
    assert told is not None
    np.testing.assert_array_equal(told.steps, steps)
    assert (told.on, untold) == (None, None)
    np.testing.assert_array_equal(told.log_e(KEY, "relief", ["acme", "other"]), [0.0, 0.0])


@pytest.mark.parametrize("n", [-1, 2, 3, MOST_VERTICES + 1, 2.0, True, None, "4"])
def test_a_wrong_number_of_vertices_is_refused(stored, tmp_path, n) -> None:
    item = replace(stored.items[0], vertices=VertexEvidence(np.zeros(4, dtype=np.int16)))
    vertices = replace(stored, items=(item,))
    changed_header(vertices, tmp_path, lambda header, item, variants: item.update(vertices=n))
    with pytest.raises(InputError, match="not an evidence file"):
        load_evidence(tmp_path / "changed")


def test_a_header_of_an_older_version_tells_of_no_vertices(stored, tmp_path) -> None:
    save_evidence(stored, tmp_path / "e")
    header, _ = content(tmp_path / "e")
    assert "vertices" not in header["items"][0]
    assert load_evidence(tmp_path / "e").items[0].vertices is None


def test_the_same_evidence_gives_the_same_bytes(stored, tmp_path) -> None:
    for name in ("one", "two"):
        save_evidence(stored, tmp_path / name)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


@pytest.mark.parametrize("keep", [0, 10, 200, -30])
def test_a_torn_file_is_refused(stored, tmp_path, keep) -> None:
    save_evidence(stored, tmp_path / "e")
    (tmp_path / "torn").write_bytes((tmp_path / "e").read_bytes()[:keep])
    for authenticated in (True, False):
        with pytest.raises(InputError, match=r"torn: (is not|does not begin)"):
            load_evidence(tmp_path / "torn", authenticated=authenticated)


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_a_changed_bit_is_refused(stored, tmp_path, place, bit) -> None:
    save_evidence(stored, tmp_path / "e")
    data = bytearray((tmp_path / "e").read_bytes())
    data[int(place * len(data))] ^= 1 << bit
    (tmp_path / "changed").write_bytes(data)
    with pytest.raises(InputError):
        load_evidence(tmp_path / "changed")


def secret() -> bytes:
    """Return the local secret, by the file it is kept in."""
    return bytes.fromhex(Path(os.environ["MESHMARK_EVIDENCE_SECRET"]).read_text().split()[1])


def content(path) -> tuple[dict, bytes]:
    """Return the header of an evidence file, and the bytes of its arrays."""
    data = gzip.decompress(path.read_bytes()[len(KIND) + 32 :])
    (length,) = struct.unpack("<I", data[:4])
    return json.loads(data[4 : 4 + length]), data[4 + length :]


def resealed(path, header, arrays: bytes, *, length: int | None = None) -> None:
    """Write an evidence file as somebody who knows the local secret could."""
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    prefix = struct.pack("<I", len(text) if length is None else length)
    payload = gzip.compress(prefix + text + arrays)
    path.write_bytes(KIND + hmac.digest(secret(), KIND + payload, "sha256") + payload)


def forged(path) -> None:
    """Give an evidence file the seal of somebody without the secret."""
    data = path.read_bytes()
    payload = data[len(KIND) + 32 :]
    path.write_bytes(KIND + hmac.digest(bytes(32), KIND + payload, "sha256") + payload)


def judged(stored: StoredEvidence, *, authenticated: bool):
    found = AssetEvidence("a", stored.items, len(stored.recipes), stored.notes, 0.0, authenticated)
    return judge_all(found, KEY)


def test_the_same_bytes_sealed_by_the_secret_are_read(stored, tmp_path) -> None:
    save_evidence(stored, tmp_path / "e")
    resealed(tmp_path / "same", *content(tmp_path / "e"))
    assert load_evidence(tmp_path / "same").files == stored.files


def test_evidence_under_another_files_hash_is_refused(stored, tmp_path) -> None:
    save_evidence(stored, tmp_path / "e")
    header, arrays = content(tmp_path / "e")
    header["files"] = [["innocent.usdc", "1" * 64]]
    resealed(tmp_path / "relabelled", header, arrays)
    forged(tmp_path / "relabelled")
    with pytest.raises(InputError, match="not authentic"):
        load_evidence(tmp_path / "relabelled")
    told = load_evidence(tmp_path / "relabelled", authenticated=False)
    assert told.files == (("innocent.usdc", "1" * 64),)


def test_evidence_of_another_machine_is_told_of_but_carries_no_verdict(
    stored, tmp_path, monkeypatch
) -> None:
    words = KEY.words("apex", 8, 5)
    value = 0.9 * np.tile(words[:4].astype(float), (2, 1, 1, 1))
    variant = RestoredVariant.of(value, np.zeros(1), posteriors=posteriors(1, 4))
    item = replace(stored.items[0], variants=(variant,))
    save_evidence(replace(stored, items=(item,)), tmp_path / "e")
    monkeypatch.setenv("MESHMARK_EVIDENCE_SECRET", str(tmp_path / "another" / "secret"))
    with pytest.raises(InputError, match="MESHMARK_EVIDENCE_SECRET"):
        load_evidence(tmp_path / "e")
    # A secret of its own does not help.
    save_evidence(stored, tmp_path / "own")
    with pytest.raises(InputError, match="not authentic"):
        load_evidence(tmp_path / "e")
    loaded = load_evidence(tmp_path / "e", authenticated=False)
    plain, verdict = (judged(loaded, authenticated=known) for known in (True, False))
    assert plain.log10_p < 0.0
    assert (verdict.verdict, verdict.log10_p, verdict.recipient) == ("inconclusive", 0.0, None)
    assert "unauthenticated" in verdict.notes[-1]
    assert f"{plain.log10_p:.2f}" in verdict.notes[-1]
    assert verdict.as_json()["unauthenticated"]["log10_p"] == plain.log10_p


def test_the_secret_is_made_once_and_for_its_owner_only(stored, tmp_path, monkeypatch) -> None:
    place = tmp_path / "new" / "folder" / "secret"
    monkeypatch.setenv("MESHMARK_EVIDENCE_SECRET", str(place))
    save_evidence(stored, tmp_path / "e")
    made = place.read_bytes()
    if os.name == "posix":
        assert place.stat().st_mode & 0o777 == 0o600
    save_evidence(stored, tmp_path / "e")
    assert place.read_bytes() == made
    assert [path.name for path in place.parent.iterdir()] == ["secret"]
    assert secret() not in (tmp_path / "e").read_bytes()


@pytest.mark.parametrize("text", ["", "meshmark-key-1\n" + "0" * 64, "\xff"])
def test_what_is_no_secret_is_refused(stored, tmp_path, monkeypatch, text) -> None:
    (tmp_path / "secret").write_bytes(text.encode("latin-1"))
    monkeypatch.setenv("MESHMARK_EVIDENCE_SECRET", str(tmp_path / "secret"))
    with pytest.raises(InputError, match="not a secret"):
        save_evidence(stored, tmp_path / "e")
    assert not (tmp_path / "e").exists()


def test_a_secret_that_cannot_be_made_is_told_of(stored, tmp_path, monkeypatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("MESHMARK_EVIDENCE_SECRET", str(tmp_path / "file" / "secret"))
    with pytest.raises(OutputError, match="MESHMARK_EVIDENCE_SECRET"):
        save_evidence(stored, tmp_path / "e")


@pytest.mark.parametrize(
    "make", [lambda file: np.savez(file, header=np.array("{}")), lambda file: file.write(b"{}")]
)
def test_files_of_older_versions_or_somebody_elses_are_refused(tmp_path, make) -> None:
    with (tmp_path / "e").open("wb") as file:
        make(file)
    for authenticated in (True, False):
        with pytest.raises(InputError, match="older version"):
            load_evidence(tmp_path / "e", authenticated=authenticated)


@pytest.mark.parametrize("name", ["nothing.here", "folder"])
def test_a_missing_file_is_named(tmp_path, name) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match=name):
        load_evidence(tmp_path / name)


def changed_header(stored, tmp_path, change) -> None:
    save_evidence(stored, tmp_path / "e")
    header, arrays = content(tmp_path / "e")
    change(header, header["items"][0], header["items"][0]["strands"])
    resealed(tmp_path / "changed", header, arrays)


@pytest.mark.parametrize(
    "change",
    [
        lambda header, item, variants: header.pop("notes"),
        lambda header, item, variants: header.update(extra=1),
        lambda header, item, variants: header.update(notes=["x" * 10_000]),
        lambda header, item, variants: header.update(notes=["\ud800"]),
        lambda header, item, variants: header.update(files={"a": "b"}),
        lambda header, item, variants: header.update(files=[["a"]]),
        lambda header, item, variants: header.update(recipes=[{"scheme": "apex"}]),
        lambda header, item, variants: header.update(items=[]) or header.update(items=None),
        lambda header, item, variants: item.update(scheme="another"),
        lambda header, item, variants: item.update(n_words=7),
        lambda header, item, variants: item.update(n_words=10**9),
        lambda header, item, variants: item.update(n_frames=0),
        lambda header, item, variants: item.update(n_frames=FRAMES),
        lambda header, item, variants: item.update(n_frames=True),
        lambda header, item, variants: item.update(tracked=1),
        lambda header, item, variants: item.update(bit_threshold=1.0),
        lambda header, item, variants: item.update(bit_threshold=float("nan")),
        lambda header, item, variants: item.update(variants=[]),
        lambda header, item, variants: item.update(variants=variants * 200),
        lambda header, item, variants: variants[0].update(log_belief=0.1),
        lambda header, item, variants: variants[0].update(log_belief=0.0),
        lambda header, item, variants: variants[0].update(log_belief=float("-inf")),
        lambda header, item, variants: variants[0].update(restored=-1),
        lambda header, item, variants: variants[0].update(shape=[3, 4]),
        lambda header, item, variants: variants[0].update(shape=[3, 4, 0]),
        lambda header, item, variants: variants[0].update(shape=[2**16, 2**12, 2**12]),
        lambda header, item, variants: variants[0].update(shape=[-3, -4, 5]),
        lambda header, item, variants: variants[0].update(placed=False),
    ],
)
def test_headers_that_make_no_sense_are_refused(stored, tmp_path, change) -> None:
    changed_header(stored, tmp_path, change)
    for authenticated in (True, False):
        with pytest.raises(InputError, match="not an evidence file"):
            load_evidence(tmp_path / "changed", authenticated=authenticated)


@pytest.mark.parametrize(
    "text", [b"[" * 100_000, b"{", b"null", b"\xff", b'{"a": ' + b"9" * 5000 + b"}", b"1e999"]
)
def test_headers_that_are_no_header_are_refused(stored, tmp_path, text) -> None:
    save_evidence(stored, tmp_path / "e")
    resealed(tmp_path / "changed", text, b"")
    with pytest.raises(InputError, match="not an evidence file"):
        load_evidence(tmp_path / "changed")


def test_what_claims_to_be_large_is_refused_before_there_is_room_for_it(stored, tmp_path) -> None:
    save_evidence(stored, tmp_path / "e")
    header, arrays = content(tmp_path / "e")
    resealed(tmp_path / "header", header, arrays, length=LONGEST + 1)
    with pytest.raises(InputError, match="not an evidence file"):
        load_evidence(tmp_path / "header")
    # Zeros compress a thousandfold, and a stranger's file may not unfold so far.
    item = header["items"][0]
    item["n_frames"], item["strands"] = 10_000, item["strands"][:1]
    item["strands"][0].update(shape=[1, 1, 100], placed=False, log_belief=0.0)
    zeros = bytes(8 * 10_000 + 8 + 100 * 10_000)
    resealed(tmp_path / "bomb", header, zeros)
    assert len(zeros) > EXPANSION * (tmp_path / "bomb").stat().st_size
    with pytest.raises(InputError, match="not an evidence file"):
        load_evidence(tmp_path / "bomb", authenticated=False)
    assert len(load_evidence(tmp_path / "bomb").items[0].times) == 10_000


def of_one_strand(stored, **changed) -> StoredEvidence:
    variant = replace(stored.items[0].variants[0], log_belief=0.0, **changed)
    return replace(stored, items=(replace(stored.items[0], variants=(variant,)),))


def with_placements(stored, change) -> StoredEvidence:
    old = stored.items[0].variants[0]
    frames = [replace(f, posterior=change(f.posterior)) for f in old.frames]
    return of_one_strand(stored, frames=tuple(frames))


@pytest.mark.parametrize(
    "change",
    [
        lambda s: replace(s, items=(replace(s.items[0], variants=s.items[0].variants * 2),)),
        lambda s: of_one_strand(s, log_prior=np.log([0.5, 0.5, 0.5])),
        lambda s: of_one_strand(s, log_prior=np.array([-1.0, np.nan, -2.0])),
        lambda s: of_one_strand(s, log_prior=np.array([-1.0, -np.inf, -2.0])),
        lambda s: of_one_strand(s, log_prior=np.array([1e-3, -9.0, -9.0])),
        lambda s: replace(s, items=(replace(s.items[0], times=np.array([1.0, np.inf])),)),
        lambda s: with_placements(s, lambda p: replace(p, position=p.position + 8.0)),
        lambda s: with_placements(s, lambda p: replace(p, position=p.position - 8.0)),
        lambda s: with_placements(
            s, lambda p: replace(p, position=np.full_like(p.position, np.inf))
        ),
        lambda s: with_placements(s, lambda p: replace(p, p_null=p.p_null * 0.0)),
        lambda s: with_placements(s, lambda p: replace(p, p_null=p.p_null + 1.0)),
        lambda s: with_placements(s, lambda p: replace(p, p_null=p.p_null * np.nan)),
    ],
)
def test_beliefs_that_are_none_are_refused(stored, tmp_path, change) -> None:
    save_evidence(of_one_strand(stored), tmp_path / "good")
    load_evidence(tmp_path / "good")
    save_evidence(change(stored), tmp_path / "e")
    for authenticated in (True, False):
        with pytest.raises(InputError, match="not an evidence file"):
            load_evidence(tmp_path / "e", authenticated=authenticated)


def test_ten_thousand_strands_of_nothing_are_no_evidence(stored, tmp_path) -> None:
    nothing = RestoredVariant.of(np.zeros((2, 1, 1, 5)), np.zeros(1), posteriors=posteriors(1, 1))
    for n in (2, 200, 10_000):
        item = replace(stored.items[0], variants=(nothing,) * n)
        save_evidence(replace(stored, items=(item,)), tmp_path / "e")
        with pytest.raises(InputError, match="not an evidence file"):
            load_evidence(tmp_path / "e")


def loaded_or_refused(path, authenticated: bool) -> StoredEvidence | None:
    """Load an evidence file; None where it is said in one line that it is none."""
    try:
        return load_evidence(path, authenticated=authenticated)
    except InputError as error:
        if "not an evidence file" not in str(error):
            raise
        return None


VALUES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**70), 2**70),
    st.integers(-2, 10),
    st.floats(),
    st.text(max_size=8),
    st.sampled_from(["[]", "{}", "[[]]", "[0, 0, 0]", '"apex"', "NaN"]).map(json.loads),
)


def places(value, path=()):
    """List the paths to everything within a JSON value."""
    yield path
    if isinstance(value, list):
        value = dict(enumerate(value))
    for name, inner in value.items() if isinstance(value, dict) else ():
        yield from places(inner, (*path, name))


@settings(max_examples=400, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_altered_structures_are_refused_or_make_sense(stored, tmp_path, data) -> None:
    save_evidence(stored, tmp_path / "e")
    header, arrays = content(tmp_path / "e")
    for _ in range(data.draw(st.integers(1, 3))):
        *path, last = data.draw(st.sampled_from([p for p in places(header) if p]))
        within = header
        for name in path:
            within = within[name]
        if isinstance(within, dict) and data.draw(st.booleans()):
            del within[last]
        elif isinstance(within, list) and data.draw(st.booleans()):
            within.append(within[last])
        else:
            within[last] = data.draw(VALUES)
    begin = data.draw(st.integers(0, len(arrays)))
    splice = data.draw(st.one_of(st.just(b""), st.binary(max_size=16)))
    arrays = arrays[:begin] + splice + arrays[begin + len(splice) :]
    resealed(tmp_path / "changed", header, arrays)
    for authenticated in (True, False):
        loaded = loaded_or_refused(tmp_path / "changed", authenticated)
        if loaded is None:
            continue
        verdict = judged(loaded, authenticated=authenticated)
        assert verdict.log10_p <= 0.0
        assert authenticated or verdict.verdict == "inconclusive"
        json.dumps(verdict.as_json(), allow_nan=False)


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_altered_streams_are_refused(stored, tmp_path, data) -> None:
    save_evidence(stored, tmp_path / "e")
    whole = (tmp_path / "e").read_bytes()
    payload = bytearray(whole[len(KIND) + 32 :])
    for _ in range(data.draw(st.integers(1, 4))):
        payload[data.draw(st.integers(0, len(payload) - 1))] ^= data.draw(st.integers(1, 255))
    payload = payload[: data.draw(st.integers(0, len(payload)))] + data.draw(st.binary(max_size=4))
    (tmp_path / "changed").write_bytes(KIND + bytes(32) + payload)
    if loaded_or_refused(tmp_path / "changed", authenticated=False) is not None:
        # The name, flags and time in the head of a gzip stream mean nothing.
        assert zlib.decompress(payload, 31) == zlib.decompress(whole[len(KIND) + 32 :], 31)
