"""Tries keys and names on all evidence of a store; no geometry is read."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import overload

import numpy as np

from meshmark.commands.trials import UNAUTHENTICATED, Match, Refusal, Trial
from meshmark.detection.evidence_store import (
    EvidenceStore,
    Row,
    asset_evidence,
    content_hash,
    identity,
    rows,
)
from meshmark.detection.gathering import AssetEvidence
from meshmark.detection.joint_verdict import paid_for
from meshmark.detection.key_screen import KeyScreen, KeyWords, WordsNeeded
from meshmark.detection.verdict import Answer, Verdict
from meshmark.detection.verify import judge_all
from meshmark.errors import InputError, MeshmarkError
from meshmark.keys import Key, octets_of_keys
from meshmark.recipients import spellings
from meshmark.workers.ordered_map import ordered_map, sharing_workers

# So few keys are all judged exactly.
FEW_KEYS = 4
# Keys times names whose words are held at once, and files that one task reads.
PAIRS_AT_ONCE, FILES_AT_ONCE = 32768, 8
# Of more files than this, all words of a key are derived once, rather than the few each asks for.
FEW_FILES = 8


class KeyFiles(Sequence[Key]):
    """Keys that are read from their files when they are asked for; pickles without secrets."""

    def __init__(self, paths: Sequence[Path]) -> None:
        self._paths = tuple(paths)

    def __len__(self) -> int:
        return len(self._paths)

    @overload
    def __getitem__(self, index: int) -> Key: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[Key]: ...

    def __getitem__(self, index: int | slice) -> Key | Sequence[Key]:
        if isinstance(index, slice):
            return [Key.load(path) for path in self._paths[index]]
        return Key.load(self._paths[index])


@sharing_workers
def try_keys(
    store: EvidenceStore,
    keys: Sequence[Key],
    *,
    recipients: Sequence[str] = (),
    fpr: float = 1e-6,
    authenticated: bool = True,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[list[Trial], list[Refusal]]:
    """Try keys, and names of each, on every source of a store.

    Parameters
    ----------
    keys : sequence of Key
        Each once. Sent to worker processes, and asked for there.
    recipients : sequence of str
        Names to try of each key, beside the owner.
    fpr : float
        Largest p that counts as marked.
    authenticated : bool
        Whether to ask for the seal of the local secret. What does not bear it is refused, or
        else tried but never decides.
    progress : callable, optional
        Called with tasks done, and how many there are.

    Returns
    -------
    trials : list of Trial
        Of each source that was measured in one way, those with the lowest p first.
    refusals : list of Refusal
        Files and rows that are not what a store holds.

    Notes
    -----
    Of n keys, each has an n-th of the rate: p of what is found is multiplied by n (union bound),
    beside what `decide` corrects for. Sources share nothing: p is that of each by itself. Of many
    keys, those are judged exactly that may be found: see `KeyScreen`.
    """
    paths = store.paths()
    names = spellings(recipients)
    ask = _Ask(keys, names, fpr, authenticated, len(paths))
    size = max(1, PAIRS_AT_ONCE // (1 + len(names)))
    tasks = [
        (tuple(paths[n : n + FILES_AT_ONCE]), first, min(first + size, len(keys)))
        for first in range(0, len(keys), size)
        for n in range(0, len(paths), FILES_AT_ONCE)
    ]
    # What is not authentic may claim to be what is, and takes its place nowhere.
    trials: dict[tuple[str, bool], Trial] = {}
    refusals: dict[Refusal, None] = {}
    for done, found in enumerate(ordered_map(ask, tasks, jobs=jobs)):
        if progress is not None:
            progress(done + 1, len(tasks))
        for each in found:
            if isinstance(each, Refusal):
                refusals[each] = None
                continue
            known = trials.setdefault((each.identity, each.authenticated), each)
            if known is not each and known.place == each.place:
                trials[each.identity, each.authenticated] = known.joined(each)
    return sorted(trials.values(), key=lambda trial: trial.rank), list(refusals)


class _Ask:
    """Tries a run of keys on the evidence in some files."""

    def __init__(
        self,
        keys: Sequence[Key],
        names: Sequence[str],
        fpr: float,
        authenticated: bool,
        n_files: int,
    ) -> None:
        self._keys, self._names = keys, (None, *names)
        self._fpr, self._authenticated = fpr, authenticated
        self._derives_all = n_files > FEW_FILES
        self._n_pairs = len(keys) * len(self._names) * n_files
        self._derived: tuple[tuple[int, int], _Words] | None = None

    def __call__(self, task: tuple[tuple[Path, ...], int, int]) -> list[Trial | Refusal]:
        paths, begin, end = task
        if self._derived is None or self._derived[0] != (begin, end):
            words = _Words(self._keys[begin:end], self._names, self._derives_all)
            self._derived = (begin, end), words
        words = self._derived[1]
        return [each for path in paths for each in self._file(path, words)]

    def _file(self, path: Path, words: _Words) -> Iterator[Trial | Refusal]:
        try:
            for row in rows(path):
                try:
                    yield self._row(row, words)
                except MeshmarkError as error:
                    yield Refusal(str(error), error.exit_code)
        except InputError as error:
            yield Refusal(str(error), error.exit_code)

    def _row(self, row: Row, words: _Words) -> Trial:
        authenticated = True
        try:
            stored = row.load()
        except InputError:
            if self._authenticated:
                raise
            stored, authenticated = row.load(authenticated=False), False
        evidence = asset_evidence(stored)
        tried, answer = self._worth_judging(evidence, words)
        judged = [(key, self._judged(evidence, key)) for key in tried]
        if judged:
            best = min((verdict for _, verdict in judged), key=lambda verdict: verdict.log10_p)
            answer = best.verdict
        matches = [Match(key.id, verdict) for key, verdict in judged if verdict.verdict == "marked"]
        matches.sort(key=lambda match: match.verdict.log10_p)
        return Trial(
            place=row.place,
            source=evidence.source,
            sha256=content_hash(stored),
            verdict=answer if authenticated else "inconclusive",
            log10_p=min((verdict.log10_p for _, verdict in judged), default=None),
            matches=tuple(matches),
            notes=stored.notes if authenticated else (*stored.notes, UNAUTHENTICATED),
            authenticated=authenticated,
            identity=identity(stored),
        )

    def _worth_judging(
        self, evidence: AssetEvidence, words: _Words
    ) -> tuple[Sequence[Key], Answer]:
        """Choose keys to be judged, and tell what is to be said if there are none."""
        if len(self._keys) <= FEW_KEYS:
            return words.keys, "not marked"
        screen = KeyScreen(evidence, len(self._names), self._share, self._n_pairs)
        derived = {scheme: words.of(scheme, needed) for scheme, needed in screen.needed.items()}
        fits = screen.may_be_found(derived, len(words.keys) * len(self._names))
        kept = fits.reshape(len(words.keys), len(self._names)).any(axis=1)
        return [words.keys[n] for n in np.flatnonzero(kept).tolist()], screen.answer

    def _judged(self, evidence: AssetEvidence, key: Key) -> Verdict:
        names = [name for name in self._names if name is not None]
        verdict = judge_all(evidence, key, recipients=names, fpr=self._share)
        return paid_for(verdict, len(self._keys))

    @property
    def _share(self) -> float:
        """The share of the rate that each key has."""
        return self._fpr / len(self._keys)


class _Words:
    """Words of some keys and names, derived when a scheme's are first asked for."""

    def __init__(self, keys: Sequence[Key], names: Sequence[str | None], derives_all: bool) -> None:
        self.keys, self._names, self._derives_all = keys, names, derives_all
        self._known: dict[str, tuple[WordsNeeded, KeyWords]] = {}

    def of(self, scheme: str, needed: WordsNeeded) -> KeyWords:
        """Return at least those words of a scheme that are needed."""
        if self._derives_all:
            needed = replace(needed, numbers=np.arange(needed.n_words))
        known = self._known.get(scheme)
        if known is not None and _holds(known[0], needed):
            return known[1]
        octets = octets_of_keys(
            self.keys, scheme, needed.numbers.tolist(), needed.n_chips, self._names
        )
        derived = KeyWords(needed.numbers, octets.reshape(-1, *octets.shape[2:]))
        self._known[scheme] = needed, derived
        return derived


def _holds(known: WordsNeeded, needed: WordsNeeded) -> bool:
    return known.n_chips >= needed.n_chips and bool(np.isin(needed.numbers, known.numbers).all())
