"""Evidence as a store keeps it, made without any mesh."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

from meshmark.detection.evidence import Evidence, InformedFacts, RestoredVariant
from meshmark.detection.evidence_file import StoredEvidence
from meshmark.keys import Key
from meshmark.statistics.word_windows import WordPosterior

N_WORDS, CARRIERS, CHIPS, READINGS = 24, 5, 16, 12


def key(number: int) -> Key:
    return Key(hashlib.sha256(f"key {number}".encode()).digest())


def mesh(
    seed: int,
    marked: Key | None = None,
    recipient: str | None = None,
    *,
    prim: str = "/A",
    n_frames: int = 1,
) -> Evidence:
    """Evidence of a mesh as it is and smoothed; with a mark, one reading holds five words."""
    rng = np.random.default_rng(seed)
    place = rng.uniform(0.0, N_WORDS - 1.0, size=(READINGS, CARRIERS))
    place[4] = np.arange(3, 3 + CARRIERS)
    where = WordPosterior(place, np.full(CARRIERS, 0.2))
    soft = rng.uniform(-0.7, 0.7, size=(2, n_frames, READINGS, CARRIERS, CHIPS))
    if marked is not None:
        words = marked.words("apex", N_WORDS, CHIPS, recipient)
        soft[0, :, 4] = 0.3 * soft[0, :, 4] + 0.6 * words[3 : 3 + CARRIERS]
    prior = np.full(READINGS, -np.log(READINGS))
    variants = tuple(
        RestoredVariant.of(each, prior, 10 * n, np.log(0.5), posteriors=(where,) * n_frames)
        for n, each in enumerate(soft)
    )
    return Evidence(prim, "apex", N_WORDS, np.arange(float(n_frames)), variants)


def beside_the_original(
    seed: int, marked: Key | None = None, recipient: str | None = None
) -> Evidence:
    """Evidence of a mesh that was laid upon its original, where all carriers share one word."""
    rng = np.random.default_rng(seed)
    soft = rng.uniform(-0.5, 0.5, size=(1, 2, 1, 200))
    if marked is not None:
        soft += 0.3 * marked.words("relief", 1, 200, recipient)
    variant = RestoredVariant.of(soft, np.log([0.5, 0.5]))
    facts = InformedFacts("/A", (0.0,), ("similarity",), "identity", 0.0, 1.0, 200)
    return Evidence("/A", "relief", 1, np.zeros(1), (variant,), informed=facts)


def source(
    name: str, items: Sequence[Evidence], frames: str | None = None, **known: object
) -> StoredEvidence:
    digest = hashlib.sha256(name.encode()).hexdigest()
    beside = any(item.informed is not None for item in items)
    original = (("original.usd", "0" * 64),) if beside else ()
    schemes = dict.fromkeys(item.scheme for item in items) or ["apex"]
    recipes = [{"scheme": {"name": scheme}} for scheme in schemes]
    given = {"path": f"/shots/{name}", "version": "1", **known}
    return StoredEvidence(
        ((name, digest),), original, recipes, frames, tuple(items), ("a note",), **given
    )
