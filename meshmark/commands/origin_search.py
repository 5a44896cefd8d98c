"""What one suspect says alone, and beside one original of a ledger after the other."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from meshmark.alignment.likeness import hypotheses, signatures, unlikeness
from meshmark.commands.identification import Candidate, layers_of
from meshmark.detection.evidence import Evidence
from meshmark.detection.gathering import AssetEvidence, Survey
from meshmark.detection.joint_verdict import jointly, paid_for
from meshmark.detection.looks import ONE_LOOK
from meshmark.detection.verdict import Verdict
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
from meshmark.workers.pool import one_thread
from meshmark.workers.progress import MeshProgress

# Originals whose signatures are kept for the next suspect, 0.6 MB each at most.
REMEMBERED = 512


@dataclass(frozen=True, eq=False)
class Known:
    """An origin of which the key is at hand, and its layers."""

    origin: Origin
    key: Key
    blind: tuple[Recipe, ...]
    informed: tuple[Recipe, ...]

    @classmethod
    def of(cls, origin: Origin, key: Key) -> Known:
        """Build the layers of an origin from what its manifest tells."""
        recipes = layers_of(origin)
        blind = tuple(recipe for recipe in recipes if not recipe.informed)
        return cls(origin, key, blind, tuple(recipe for recipe in recipes if recipe.informed))

    @property
    def alone(self) -> tuple[str, ...]:
        """Tell what is read of it alone: origins of one key that share it are judged together."""
        return (self.key.id, *map(_identity, self.blind))


class OriginSearch:
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
        self._known: list[Known] = []
        lacking: dict[str, int] = {}
        for origin in origins:
            if origin.key_id not in keys:
                lacking[origin.key_id] = lacking.get(origin.key_id, 0) + len(origin.copies)
                continue
            try:
                self._known.append(Known.of(origin, keys[origin.key_id]))
            except MeshmarkError as error:
                self.left_out += 1
                self._note(f"{origin.asset} {origin.version}: {error.message}")
        for key_id, n in lacking.items():
            self.left_out += n
            self._note(f"key {key_id} is missing: {n} copies were not looked for")
        self._groups: dict[tuple[str, ...], list[Known]] = {}
        for known in self._known:
            if known.blind:
                self._groups.setdefault(known.alone, []).append(known)

    @cached_property
    def hypotheses(self) -> int:
        """Number of words that are tried, or would be."""
        alone = sum(1 + len(_names(group)) for group in self._groups.values())
        return alone + sum(known.origin.hypotheses for known in self.readable)

    @cached_property
    def readable(self) -> list[Known]:
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

    def ranked(self, alone: Sequence[Candidate]) -> Iterator[Known]:
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

    def beside(self, known: Known) -> Candidate:
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

    def _judged(self, known: Known, names: Sequence[str]) -> Verdict:
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

    def _original(self, known: Known) -> tuple[Asset, Any]:
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

    def _unlikeness(self, known: Known) -> float:
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


def _identity(recipe: Recipe) -> str:
    return canonical(recipe.as_json())


def _names(group: Sequence[Known]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for known in group for name in known.origin.names))
