"""Evidence that words are screened on, and words that fit it."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from scipy.special import logsumexp

from meshmark.statistics.p_values import word_log_e_means
from meshmark.statistics.screening import Screened
from meshmark.statistics.word_windows import WordPosterior

# Words of a key.
M = 12


@st.composite
def evidence(draw: st.DrawFn) -> tuple[Screened, ...]:
    """Evidence read in one or two ways, weak or strong, with some chips and carriers missing."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    C, K = draw(st.integers(1, 5)), draw(st.integers(1, 20))
    found = []
    for R in draw(st.lists(st.integers(1, 6), min_size=1, max_size=2)):
        size = draw(st.sampled_from([0.01, 0.3, 1.0]))
        S = np.clip(size * rng.normal(size=(R, C, K)), -1, 1)
        S[rng.random(S.shape) < draw(st.sampled_from([0.0, 0.5, 1.0]))] = 0.0
        place = rng.uniform(0, M - 1, size=(R, C))
        place[:, rng.random(C) < 0.2] = np.nan
        prior = rng.dirichlet(np.ones(R)) * rng.uniform(0.1, 0.5)
        where = WordPosterior(place, rng.uniform(0.01, 1.0, size=C))
        found.append(Screened(S, np.log(np.maximum(prior, 1e-30)), where))
    return tuple(found)


def exact(items: tuple[Screened, ...], words: np.ndarray) -> np.ndarray:
    each = [word_log_e_means(item.S, item.log_prior, words, item.posterior) for item in items]
    return logsumexp(each, axis=0)


def some_words(items: tuple[Screened, ...], rng: np.random.Generator) -> np.ndarray:
    """Random words, and words that fit one hypothesis as well as any could."""
    C, K = items[0].S.shape[1:]
    words = 2 * rng.integers(0, 2, size=(20, M, K)) - 1
    for n, item in enumerate(items * 5):
        r, first = n % len(item.S), item.posterior.first_words(M)
        for c in range(C):
            best = np.where(item.S[r, c] >= 0, 1, -1)
            words[n, first[r, c] + rng.integers(0, 8)] = best
    return words.astype(np.int8)
