"""Which asset a suspect is a copy of, and whose copy, by all keys and names of a ledger.

The suspect is measured alone, once. All keys and names are tried on that. Then it is laid upon
the originals that it is most like, and what it says beside them is added. Every name is paid for
beside every original it got a copy of, whether or not that original is looked at.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from meshmark.alignment.likeness import hypotheses, signatures, unlikeness
from meshmark.commands.identification import Candidate, Identification
from meshmark.detection.evidence import Evidence
from meshmark.detection.gathering import AssetEvidence, Survey
from meshmark.detection.joint_verdict import jointly, paid_for
from meshmark.detection.looks import ONE_LOOK
from meshmark.detection.verdict import Answer, Verdict
from meshmark.detection.verify import judge_all, verify_informed
from meshmark.embedding.asset import embed
from meshmark.embedding.manifest import output_hashes
from meshmark.errors import InputError, MeshmarkError
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key
from meshmark.ledger.chain import canonical
from meshmark.ledger.origins import Origin
from meshmark.mesh.asset import Asset
from meshmark.sources.digests import source_digests
from meshmark.sources.reading import read
from meshmark.workers.ordered_map import sharing_workers
from meshmark.workers.pool import one_thread
from meshmark.workers.progress import MeshProgress

# Originals that a suspect is laid upon, unless more are asked for.
MOST = 8
# Originals whose signatures are kept for the next suspect, 0.6 MB each at most.
REMEMBERED = 512


@sharing_workers
def identify(
    suspect: Asset,
    origins: Sequence[Origin],
    keys: Mapping[str, Key],
    *,
    fpr: float = 1e-6,
    most: int = MOST,
    everything: bool = False,
    jobs: int = 1,
    progress: MeshProgress | None = None,
) -> Identification:
    """Say which asset, version and recipient of a ledger a suspect is a copy of.

    Parameters
    ----------
    suspect : Asset
    origins : sequence of Origin
        All that the ledger knows.
    keys : mapping of str to Key
        By key id. Origins of other keys are left out, and told of.
    fpr : float
        Largest p that counts as marked.
    most : int
        Originals that the suspect is laid upon, those first that it is most like.
    everything : bool
        Go on where one was found: a suspect may hold several assets.

    Raises
    ------
    InputError
        If no frame of the suspect can be read.

    Notes
    -----
    The rate is shared evenly among hypotheses, so that p of what is found is multiplied by their
    number (union bound): one for the owner and one for each recipient, alone for each key and
    beside each original. Which originals are looked at may then depend on anything.
    """
    start = time.perf_counter()
    search = _Search(suspect, origins, keys, fpr, jobs, progress)
    candidates = search.alone()
    tried = found = 0
    assets: set[str] = set()
    for known in search.ranked(candidates):
        # Another version of what was found may fit better.
        if (found and not everything and known.origin.asset not in assets) or tried >= most:
            continue
        tried += 1
        candidate = search.beside(known)
        candidates.append(candidate)
        if candidate.by_mark:
            found += 1
            assets.add(known.origin.asset)
    left = len(search.readable) - tried
    notes = [*search.notes]
    if left and not found:
        notes.append(
            f"{left} originals that it is less like were not looked at; --most N looks at more"
        )
    order = sorted(candidates, key=_rank)
    return Identification(
        source=suspect.source,
        verdict=_answer(order, untried=left > 0 or search.left_out > 0),
        candidates=tuple(order),
        hypotheses=search.hypotheses,
        notes=tuple(notes),
        elapsed_s=time.perf_counter() - start,
    )


@dataclass(frozen=True, eq=False)
class _Known:
    """An origin of which the key is at hand, and its layers."""

    origin: Origin
    key: Key
    blind: tuple[Recipe, ...]
    informed: tuple[Recipe, ...]

    @property
    def alone(self) -> tuple[str, ...]:
        """Tell what is read of it alone: origins of one key that share it are judged together."""
        return (self.key.id, *map(_identity, self.blind))


class _Search:
    """One suspect, measured alone, and tried beside one origin after the other."""

    def __init__(
        self,
        suspect: Asset,
        origins: Sequence[Origin],
        keys: Mapping[str, Key],
        fpr: float,
        jobs: int,
        progress: MeshProgress | None,
    ) -> None:
        self._suspect, self._fpr, self._jobs, self._progress = suspect, fpr, jobs, progress
        self.notes: list[str] = []
        # What could not be looked for: nobody can say that it is not there.
        self.left_out = 0
        self._known: list[_Known] = []
        lacking: dict[str, int] = {}
        for origin in origins:
            if origin.key_id not in keys:
                lacking[origin.key_id] = lacking.get(origin.key_id, 0) + len(origin.copies)
                continue
            try:
                self._known.append(_known(origin, keys[origin.key_id]))
            except MeshmarkError as error:
                self.left_out += 1
                self._note(f"{origin.asset} {origin.version}: {error.message}")
        for key_id, n in lacking.items():
            self.left_out += n
            self._note(f"key {key_id} is missing: {n} copies were not looked for")
        self._groups: dict[tuple[str, ...], list[_Known]] = {}
        for known in self._known:
            if known.blind:
                self._groups.setdefault(known.alone, []).append(known)

    @cached_property
    def hypotheses(self) -> int:
        """Number of words that are tried, or would be."""
        alone = sum(1 + len(_names(group)) for group in self._groups.values())
        return alone + sum(known.origin.hypotheses for known in self.readable)

    @cached_property
    def readable(self) -> list[_Known]:
        """Those that something is read of beside the original."""
        return [known for known in self._known if known.informed]

    def alone(self) -> list[Candidate]:
        """Try all keys and names on what the suspect says by itself."""
        found = []
        for group in self._groups.values():
            names = _names(group)
            verdict = self._paid(self._judged(group[0], names), 1 + len(names))
            found.append(Candidate(group[0].key.id, verdict))
        return found

    def ranked(self, alone: Sequence[Candidate]) -> Iterator[_Known]:
        """List origins in the order in which they are looked at.

        First those of as many points and faces as the suspect's; of these, those whose key is in
        it, and what it is most like.
        """
        owners = {each.key_id: each.verdict.log10_p for each in alone}
        mine = {(m[0].topology.n_points, len(m[0].topology.counts)) for m in self._suspect.meshes}
        same = [known for known in self.readable if mine & set(known.origin.meshes)]
        others = [known for known in self.readable if known not in same]
        for some in (same, others):
            # Matrices are small: threads would wait for each other more than they would work.
            with one_thread():
                likeness = {id(known): self._unlikeness(known) for known in some if len(some) > 1}
            yield from sorted(
                some, key=lambda k: (owners.get(k.key.id, 0.0), likeness.get(id(k), 0.0))
            )

    def beside(self, known: _Known) -> Candidate:
        """Lay the suspect upon an original, and add that to what it says alone."""
        origin = known.origin
        alone = self._judged(known, origin.names)
        share = self._share(origin.hypotheses)
        try:
            original, master = self._original(known)
            beside = verify_informed(
                self._suspect,
                known.key,
                known.informed,
                origin.names,
                original=original,
                master=master,
                frames=None,
                fpr=share,
                jobs=self._jobs,
                progress=self._progress,
            )
        except MeshmarkError as error:
            # What was moved or changed since cannot be looked at; all else can.
            self.left_out += 1
            paid = self._paid(alone, origin.hypotheses)
            return Candidate(known.key.id, paid, origin, why=error.message)
        both = jointly(alone, beside, share) if known.blind else beside
        return Candidate(
            known.key.id,
            self._paid(both, origin.hypotheses),
            origin,
            self._paid(beside, origin.hypotheses),
            why="" if beside.prims else "; ".join(beside.notes),
        )

    def _judged(self, known: _Known, names: Sequence[str]) -> Verdict:
        """Try a key and names on what the suspect says alone."""
        if not known.blind:
            return Verdict.of_nothing(self._suspect.source)
        items = [item for recipe in known.blind for item in self._evidence[_identity(recipe)]]
        evidence = AssetEvidence(
            self._suspect.source, tuple(items), len(known.blind), (), elapsed_s=0.0
        )
        share = self._share(1 + len(names))
        return judge_all(evidence, known.key, recipients=names, fpr=share)

    @cached_property
    def _evidence(self) -> dict[str, list[Evidence]]:
        """Measure the suspect alone, by every blind layer that any origin has."""
        recipes = {_identity(recipe): recipe for known in self._known for recipe in known.blind}
        found = {}
        for name, recipe in recipes.items():
            survey = Survey(
                self._suspect,
                recipes=[recipe],
                frames=None,
                jobs=self._jobs,
                progress=self._progress,
            )
            views = survey.extractions([recipe])
            found[name] = survey.evidence(views, ONE_LOOK)
            survey.conclude(views)
            for note in survey.notes():
                self._note(note)
        return found

    def _share(self, hypotheses: int) -> float:
        """Return the share of the rate that so many hypotheses have."""
        return self._fpr * hypotheses / self.hypotheses

    def _paid(self, verdict: Verdict, hypotheses: int) -> Verdict:
        """Correct a verdict on some hypotheses for all of them."""
        return paid_for(verdict, self.hypotheses / hypotheses)

    def _original(self, known: _Known) -> tuple[Asset, Any]:
        """Read an original and its master, or what makes that again; both as they were."""
        origin = known.origin
        original = read(origin.source, parameters=origin.parameters or None, isolated=True)
        if tuple(digest for _, digest in source_digests(original)) != origin.digests:
            raise InputError("the original is not what was marked")
        if origin.master is not None:
            path = Path(origin.master["path"])
            if output_hashes(path) == origin.master["files"]:
                return original, read(path, isolated=True)
        if not known.blind:
            return original, None

        def made() -> Asset:
            return embed(original, known.key, recipe=known.blind, jobs=self._jobs).asset

        return original, made

    def _unlikeness(self, known: _Known) -> float:
        """Compare the suspect with an original at a glance; infinite where that cannot be read."""
        try:
            original = _signatures_at(known.origin.source, canonical(known.origin.parameters))
        except MeshmarkError:
            return np.inf
        return unlikeness(self._signatures, original)

    @cached_property
    def _signatures(self) -> list[Any]:
        return hypotheses(self._suspect)

    def _note(self, text: str) -> None:
        if text not in self.notes:
            self.notes.append(text)


@lru_cache(maxsize=REMEMBERED)
def _signatures_at(source: Path, parameters: str) -> Any:
    """Measure an original once for many suspects; what it is laid upon is always read anew."""
    return signatures(read(source, parameters=json.loads(parameters) or None))


def _known(origin: Origin, key: Key) -> _Known:
    """Build the layers of an origin from what its manifest tells."""
    segmenter, geodesic = origin.plugins["segmenter"], origin.plugins["geodesic"]
    recipes = [
        Recipe(
            layer["name"],
            segmenter["name"],
            geodesic["name"],
            {each["name"]: each["parameters"] for each in (layer, segmenter, geodesic)},
        )
        for layer in origin.layers
    ]
    return _Known(
        origin,
        key,
        tuple(recipe for recipe in recipes if not recipe.informed),
        tuple(recipe for recipe in recipes if recipe.informed),
    )


def _identity(recipe: Recipe) -> str:
    return canonical(recipe.as_json())


def _names(group: Sequence[_Known]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for known in group for name in known.origin.names))


def _rank(candidate: Candidate) -> tuple[bool, bool, float]:
    """Order candidates: whose mark was read beside the original, who lies on it, by p."""
    marked = candidate.verdict.verdict == "marked"
    return (not candidate.by_mark, not (marked and candidate.by_shape), candidate.verdict.log10_p)


def _answer(candidates: Sequence[Candidate], untried: bool) -> Answer:
    answers = {each.verdict.verdict for each in candidates}
    if "marked" in answers:
        return "marked"
    return "not marked" if "not marked" in answers and not untried else "inconclusive"
