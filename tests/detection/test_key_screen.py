"""Of many keys and names, nobody is lost who would be found."""

from __future__ import annotations

import numpy as np
import pytest

from detection.stored_sources import N_WORDS, beside_the_original, key, mesh, source
from meshmark.detection.evidence_store import asset_evidence
from meshmark.detection.key_screen import KeyScreen, KeyWords, WordsNeeded
from meshmark.detection.verify import judge_all
from meshmark.keys import octets_of_keys, signs_of, words_of_keys

KEYS = [key(n) for n in range(40)]
NAMES = (None, "acme")


def derived(screen: KeyScreen) -> dict[str, KeyWords]:
    found = {}
    for scheme, needed in screen.needed.items():
        octets = octets_of_keys(KEYS, scheme, needed.numbers.tolist(), needed.n_chips, NAMES)
        found[scheme] = KeyWords(needed.numbers, octets.reshape(-1, *octets.shape[2:]))
    return found


SOURCES = {
    "unmarked": [mesh(1)],
    "one mesh": [mesh(1, KEYS[7])],
    "a copy": [mesh(1, KEYS[7], "acme")],
    "meshes that say it together": [
        mesh(1, KEYS[7]),
        mesh(2, KEYS[7], prim="/B"),
        mesh(3, prim="/C"),
    ],
    "beside the original": [mesh(1), beside_the_original(2, KEYS[7], "acme")],
    "alone and beside the original": [mesh(1, KEYS[7]), beside_the_original(2, KEYS[7])],
    "nothing": [],
}


@pytest.mark.parametrize(
    ("name", "fpr"),
    [
        *((name, 1e-6) for name in SOURCES),
        ("unmarked", 1e-1),
        ("a copy", 1e-12),
        ("alone and beside the original", 1e-1),
    ],
)
def test_whoever_would_be_found_passes(name, fpr) -> None:
    evidence = asset_evidence(source("leak.usd", SOURCES[name]))
    screen = KeyScreen(evidence, len(NAMES), fpr)
    passed = screen.may_be_found(derived(screen), len(KEYS) * len(NAMES)).reshape(-1, len(NAMES))
    tried = [7, *np.flatnonzero(passed.any(axis=1))[:3], 20, 21]
    for n in tried:
        verdict = judge_all(evidence, KEYS[n], recipients=["acme"], fpr=fpr)
        assert verdict.verdict in ("marked", screen.answer)
        assert (verdict.verdict != "marked") or passed[n].any()
        for one in verdict.recipients:
            assert passed[n, NAMES.index(one.recipient)]
    marked = name not in ("unmarked", "nothing")
    assert passed[7].any() or not marked or fpr < 1e-6
    if fpr <= 1e-6:
        assert set(np.flatnonzero(passed.any(axis=1))) <= ({7} if marked else set())


def test_only_words_that_may_be_held_are_asked_for() -> None:
    screen = KeyScreen(asset_evidence(source("leak.usd", [mesh(1)])), 1, 1e-6)
    assert 8 <= len(screen.needed["apex"].numbers) <= N_WORDS
    some, others = (
        WordsNeeded(8, 16, np.array([1, 3])),
        WordsNeeded(8, 12, np.array([0, 3])),
    )
    both = some.joined(others)
    assert (both.n_words, both.n_chips, both.numbers.tolist()) == (8, 16, [0, 1, 3])
    octets = octets_of_keys(KEYS[:2], "apex", [0, 1, 3], 20)[:, 0]
    some = KeyWords(both.numbers, octets).some(others.numbers, 12)
    assert some.shape == (2, 2, 2)
    words = words_of_keys(KEYS[:2], "apex", [0, 3], 12)[:, 0]
    np.testing.assert_array_equal(signs_of(some, 12), words)
