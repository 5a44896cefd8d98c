"""What `verify` is asked of every source."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from meshmark.commands.outcome import folder_of
from meshmark.embedding.manifest import named_schemes
from meshmark.errors import UsageError
from meshmark.extension.recipe import Recipe, default_layers, layers_from_text, scheme_names
from meshmark.keys import Key
from meshmark.sources.digests import file_hashes
from meshmark.sources.isolation.hashing import digests_of


@dataclass(frozen=True, eq=False)
class Request:
    """What is asked of every source.

    It can be pickled and sent anywhere: of the key it knows the file, and the id.

    Parameters
    ----------
    key_file : Path
        Read where a source is verified.
    key_id : str
        Of the key that is to be in it.
    recipes : sequence of Recipe
        Schemes to try.
    named : bool
        Whether these only: or else also those that a manifest beside the source names.
    recipients : sequence of str
        Names to try.
    frames : str
        As of `meshmark.detection.verify.verify`.
    parameters : mapping
        Of the readers of source, original and master: each gets those that it takes.
    fpr : float
        Largest p that counts as marked.
    trusted : bool
        Read sources in this process.
    original, master : str, optional
        What sources may have been made from.
    evidence : Path, optional
        File that the evidence is read from, or written to.
    store : Path, optional
        Folder of the store that it is read from, or added to.
    authenticated : bool
        Whether that must bear the seal of the local secret.
    jobs : int
        Processes that the frames of one source are shared among.
    recorded : bool
        Whether outcomes tell the hashes of what was read, and what was asked.
    timeout : float, optional
        Seconds that one source may take.
    beside : mapping of str to sequence, optional
        Where that is recorded, the hashes of original and master; see `hashes_beside`.
    """

    key_file: Path
    key_id: str
    recipes: Sequence[Recipe]
    named: bool
    recipients: Sequence[str] = ()
    frames: str = "auto"
    parameters: Mapping[str, Any] = field(default_factory=dict)
    fpr: float = 1e-6
    trusted: bool = False
    original: str | None = None
    master: str | None = None
    evidence: Path | None = None
    store: Path | None = None
    authenticated: bool = True
    jobs: int = 1
    recorded: bool = False
    timeout: float | None = None
    beside: Mapping[str, Sequence[dict[str, str]]] = field(default_factory=dict)

    @property
    def paths(self) -> Sequence[str | Path | None]:
        """What else is read for every source, or written."""
        return (self.key_file, self.original, self.master, self.evidence, self.store)

    def recipes_for(self, source: str) -> Sequence[Recipe]:
        """List what is tried on a source: what was asked for, or else also what its manifest names.

        A scheme of which that says other parameters is to be asked for by whoever knows them.
        """
        if self.named:
            return self.recipes
        first = self.recipes[0]
        known = {recipe.scheme for recipe in self.recipes}
        told = [name for name in named_schemes(Path(source)) if name not in known]
        there = set(scheme_names()) if told else set()
        others = [replace(first, scheme=name, settings={}) for name in told if name in there]
        return (*self.recipes, *others)

    @property
    def master_layers(self) -> list[Recipe]:
        """What the master is made by."""
        return [recipe for recipe in self.recipes if not recipe.informed]

    def asked(self, source: str) -> dict[str, Any]:
        """Tell all that the answer for a source depends on, beside its files.

        Names are told by their number and hash.
        """
        return {
            "key_id": self.key_id,
            "schemes": [recipe.as_json() for recipe in self.recipes_for(source)],
            "recipients": {"count": len(self.recipients), "sha256": self._names_hash},
            "frames": self.frames,
            "parameters": dict(self.parameters),
            "fpr": self.fpr,
            "original": self.beside.get("original"),
            "master": self.beside.get("master"),
            # Then one look has to do.
            **({} if self.store is None else {"stored": True}),
        }

    @cached_property
    def _names_hash(self) -> str:
        told = json.dumps(list(self.recipients))
        return hashlib.sha256(told.encode("ascii")).hexdigest()

    def key(self) -> Key:
        """Read the key.

        Raises
        ------
        UsageError
            If the file holds another one here.
        """
        key = Key.load(self.key_file)
        if key.id != self.key_id:
            raise UsageError(
                f"holds the key {key.id} here, not {self.key_id}", source=self.key_file
            )
        return key


def recipes_asked(
    schemes: Sequence[str], segmenter: str, geodesic: str, settings: Sequence[str]
) -> Sequence[Recipe]:
    """Build what was asked for, or what is tried by default."""
    if schemes:
        return layers_from_text(schemes, segmenter, geodesic, settings)
    if settings:
        raise UsageError(f"--set needs --scheme, one of {', '.join(scheme_names())}")
    return [replace(layer, segmenter=segmenter, geodesic=geodesic) for layer in default_layers()]


def hashes_beside(
    original: str | None, master: str | None, *, trusted: bool = False
) -> dict[str, list[dict[str, str]]]:
    """Hash the files of an original and a master, where there are such, for `Request.beside`.

    Raises
    ------
    InputError
        If one cannot be read.
    """
    named = {"original": original, "master": master}
    return {
        what: file_hashes(digests_of(source, trusted=trusted), folder_of(source))
        for what, source in named.items()
        if source is not None
    }
