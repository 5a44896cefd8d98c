from __future__ import annotations

import pickle
import stat

import numpy as np
import pytest
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from meshmark.errors import InputError, OutputError
from meshmark.keys import Key, readable_by_others

FIXED = Key(bytes(range(32)))


def test_words_are_frozen() -> None:
    # A change here would orphan every file marked so far.
    assert FIXED.id == "da932fab3fe3e5fb"
    words = FIXED.words("tsai2014", 2, 16)
    text = ["".join("+" if sign > 0 else "-" for sign in word) for word in words]
    assert text == ["+++-+-+---+---+-", "++-+-++-+-+-+--+"]


@pytest.mark.parametrize("n_bytes", [1, 8, 33, 500])
def test_derivation_is_hkdf(n_bytes) -> None:
    hkdf = HKDF(hashes.SHA256(), n_bytes, None, b"meshmark/1/a label")
    assert FIXED.derive("a label", n_bytes) == hkdf.derive(FIXED.secret)


def test_words_of_many_are_those_of_each() -> None:
    names = [None, "acme", "Andr\u00e9", "2/acme"]
    each = [FIXED.words("a", 3, 13, name) for name in names]
    np.testing.assert_array_equal(FIXED.words_of("a", 3, 13, names), each)


@pytest.mark.parametrize("n_chips", [1, 16, 256, 257])
def test_words_are_bits_of_derived_bytes(n_chips) -> None:
    names = [None, "acme", "Andr\u00e9", "2/acme"]
    labels = ["owner", "recipient/4/acme", "recipient/5/Andr\u00e9", "recipient/6/2/acme"]
    words = FIXED.words_of("a", 12, n_chips, names)
    for word, label in zip(words, labels, strict=True):
        for m in (0, 11):
            octets = FIXED.derive(f"word/a/{label}/{m}", -(-n_chips // 8))
            bits = np.unpackbits(np.frombuffer(octets, np.uint8), count=n_chips)
            np.testing.assert_array_equal(word[m], 2 * bits.astype(int) - 1)


def test_a_key_travels_to_other_processes_after_use() -> None:
    FIXED.words("a", 3, 13, "acme")
    assert pickle.loads(pickle.dumps(FIXED)) == FIXED


def test_words_of_recipients_schemes_and_keys_differ() -> None:
    words = [
        FIXED.words("a", 4, 64),
        FIXED.words("b", 4, 64),
        FIXED.words("a", 4, 64, "studio east"),
        FIXED.words("a", 4, 64, "studio west"),
        Key(bytes(32)).words("a", 4, 64),
    ]
    rows = np.concatenate(words)
    assert len(np.unique(rows, axis=0)) == len(rows)


def test_a_longer_word_begins_with_the_shorter() -> None:
    np.testing.assert_array_equal(FIXED.words("a", 2, 13), FIXED.words("a", 3, 40)[:2, :13])


def test_signs_are_fair() -> None:
    words = FIXED.words("a", 400, 250)
    assert set(np.unique(words)) == {-1, 1}
    # 100,000 fair signs: six standard deviations.
    assert abs(words.mean()) < 6 / np.sqrt(words.size)


def test_file_round_trip_and_permissions(tmp_path) -> None:
    path = tmp_path / "k"
    key = Key.generate()
    key.save(path)
    assert Key.load(path) == key
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert not readable_by_others(path)
    path.chmod(0o640)
    assert readable_by_others(path)


def test_a_key_is_never_overwritten(tmp_path) -> None:
    path = tmp_path / "k"
    FIXED.save(path)
    with pytest.raises(OutputError, match="never overwritten"):
        Key.generate().save(path)
    assert Key.load(path) == FIXED


def test_the_secret_is_never_shown(tmp_path) -> None:
    assert FIXED.secret.hex() not in repr(FIXED) + str(FIXED)
    path = tmp_path / "k"
    path.write_text("meshmark-key-1\n" + "a1" * 31 + "\n")
    with pytest.raises(InputError) as caught:
        Key.load(path)
    assert "a1a1" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00", b"meshmark-key-2\n" + b"00" * 32])
def test_what_is_no_key_file_is_refused(tmp_path, content) -> None:
    path = tmp_path / "k"
    path.write_bytes(content)
    with pytest.raises(InputError, match="not a meshmark key file"):
        Key.load(path)


def test_missing_key_file(tmp_path) -> None:
    with pytest.raises(InputError, match="nowhere"):
        Key.load(tmp_path / "nowhere")
