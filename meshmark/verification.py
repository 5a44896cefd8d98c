"""Verifies an asset: evidence from every mesh by every scheme asked for, then the verdict."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

from meshmark.animation import Asset, MeshAnimation
from meshmark.detection import extract
from meshmark.errors import CapacityError
from meshmark.evidence import Evidence
from meshmark.keys import Key, unique_recipients
from meshmark.marking import MeshProgress, as_asset
from meshmark.plugins import catalogue
from meshmark.recipe import DEFAULT_GEODESIC, DEFAULT_SEGMENTER, Recipe
from meshmark.timeline import frames_in
from meshmark.validation import check
from meshmark.verdict import Verdict, decide


@dataclass(frozen=True, eq=False)
class AssetEvidence:
    """What an asset says before any key is tried.

    Parameters
    ----------
    source : str
        The asset.
    items : tuple of Evidence
        One for each mesh and scheme that could be measured.
    n_schemes : int
        Schemes tried.
    notes : tuple of str
        What could not be measured, and why.
    elapsed_s : float
        Seconds spent measuring.
    """

    source: str
    items: tuple[Evidence, ...]
    n_schemes: int
    notes: tuple[str, ...]
    elapsed_s: float


def all_schemes() -> tuple[Recipe, ...]:
    """Return a recipe for each scheme there is, with its default parameters."""
    return tuple(
        Recipe(offer.name, DEFAULT_SEGMENTER, DEFAULT_GEODESIC)
        for offer in catalogue().of_kind("scheme")
    )


def gather(
    asset: Asset | MeshAnimation,
    *,
    recipes: Sequence[Recipe] = (),
    frames: str | None = None,
    jobs: int = 1,
    progress: MeshProgress | None = None,
) -> AssetEvidence:
    """Measure the evidence of every mesh; no key is involved.

    Parameters
    ----------
    recipes : sequence of Recipe
        Schemes to try; all there are, with default parameters, where empty.
    """
    start = time.perf_counter()
    whole = asset if isinstance(asset, Asset) else as_asset(asset)
    tried = tuple(recipes) or all_schemes()
    for animation in whole.meshes:
        check(animation)
    items: list[Evidence] = []
    notes: list[str] = []
    for recipe in tried:
        scheme = recipe.build()
        for animation in whole.meshes:
            tell = None if progress is None else partial(progress, animation.prim)
            try:
                items.append(
                    extract(
                        animation,
                        scheme,
                        recipe.scheme,
                        frames=frames_in(animation, frames),
                        jobs=jobs,
                        progress=tell,
                    )
                )
            except CapacityError as error:
                notes.append(f"{animation.prim}: {recipe.scheme}: {error.message}")
    elapsed = time.perf_counter() - start
    return AssetEvidence(whole.source, tuple(items), len(tried), tuple(notes), elapsed)


def verify(
    asset: Asset | MeshAnimation,
    key: Key,
    *,
    recipes: Sequence[Recipe] = (),
    recipients: Sequence[str] = (),
    frames: str | None = None,
    fpr: float = 1e-6,
    jobs: int = 1,
    progress: MeshProgress | None = None,
) -> Verdict:
    """Say whether an asset bears the key's mark, and whose copy it is.

    Parameters
    ----------
    asset : Asset or MeshAnimation
        The suspicious copy, from `meshmark.read`.
    key : Key
        The owner's key.
    recipes : sequence of Recipe
        Schemes to try, with the parameters they were embedded with; by default every scheme
        there is, with its defaults.
    recipients : sequence of str
        Names to try beside the owner's own mark; each is paid for.
    frames : str, optional
        Range A:B[:S] of time codes to look at.
    fpr : float
        False-positive rate: the largest p that counts as marked.

    Raises
    ------
    InputError
        If a frame cannot be read.
    """
    evidence = gather(asset, recipes=recipes, frames=frames, jobs=jobs, progress=progress)
    return judge_all(evidence, key, recipients=recipients, fpr=fpr)


def judge_all(
    evidence: AssetEvidence, key: Key, *, recipients: Sequence[str] = (), fpr: float = 1e-6
) -> Verdict:
    """Try a key, and any recipients, on evidence that was measured before."""
    start = time.perf_counter()
    verdict = decide(
        evidence.source,
        evidence.items,
        key,
        recipients=unique_recipients(recipients),
        fpr=fpr,
        n_schemes=evidence.n_schemes,
        notes=evidence.notes,
    )
    elapsed = evidence.elapsed_s + time.perf_counter() - start
    return replace(verdict, elapsed_s=elapsed)
