"""Codes are those of the standard library, however they are computed."""

from __future__ import annotations

import hmac

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshmark.hashing import hmac_sha256
from meshmark.hashing.hmac_sha256 import DIGEST_BYTES, KEY_BYTES, codes
from meshmark.kernels import load_loops

# Of one block, of two, and of lengths about where a block ends.
MESSAGES = st.binary(max_size=70) | st.binary(min_size=110, max_size=130)


def standard(keys: list[bytes], messages: list[bytes], n_bytes: int) -> np.ndarray:
    each = [[hmac.digest(key, message, "sha256") for message in messages] for key in keys]
    whole = np.array([[list(code) for code in of_key] for of_key in each], np.uint8)
    return whole[..., :n_bytes]


@pytest.mark.parametrize("many", [0, 10**9], ids=["loops", "OpenSSL"])
@settings(max_examples=10, deadline=None)
@given(
    messages=st.lists(MESSAGES, min_size=1, max_size=3),
    n_keys=st.sampled_from([1, 2, 63, 64, 65, 130]),
    n_bytes=st.integers(1, DIGEST_BYTES),
    seed=st.integers(0, 2**32 - 1),
)
def test_codes_are_standard(many, messages, n_keys, n_bytes, seed) -> None:
    rng = np.random.default_rng(seed)
    keys = [rng.bytes(KEY_BYTES) for _ in range(n_keys)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hmac_sha256, "MANY", many)
        found = codes(keys, messages, n_bytes)
    assert found.shape == (n_keys, len(messages), n_bytes)
    np.testing.assert_array_equal(found, standard(keys, messages, n_bytes))


def test_many_are_computed_by_loops(monkeypatch) -> None:
    """What is measured above would else be one way twice."""
    loops = pytest.importorskip("numba") and load_loops(hmac_sha256.LOOPS)
    assert loops is not None
    called = []
    monkeypatch.setattr(loops, "codes", lambda *arguments: called.append(arguments) or none(2, 1))
    keys = [bytes(KEY_BYTES)] * 3
    monkeypatch.setattr(hmac_sha256, "MANY", 6)
    codes(keys, [b"a", b"b"], 2)
    assert len(called) == 1
    codes(keys[:2], [b"a", b"b"], 2)
    assert len(called) == 1


def none(n_messages: int, n_words: int) -> np.ndarray:
    return np.zeros((n_messages, n_words, 3), np.uint32)
