"""Verifies an asset: evidence from every mesh by every scheme asked for, then the verdict."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

from meshmark.detection.gathering import AssetEvidence, gather
from meshmark.detection.looks import verify_in_looks
from meshmark.detection.verdict import Verdict, decide, without_weight
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.frame_range import AUTO
from meshmark.recipients import spellings
from meshmark.workers.ordered_map import sharing_workers
from meshmark.workers.progress import MeshProgress


@sharing_workers
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
        Names to try beside the owner's own mark, in every form of `spellings`; each is paid for.
    frames : str, optional
        Range A:B[:S] of time codes to look at, all by default; or "auto", for few frames
        first and more only while they do not decide.
    fpr : float
        False-positive rate: the largest p that counts as marked.

    Raises
    ------
    InputError
        If no frame of any mesh can be read.
    """
    if frames == AUTO:
        return verify_in_looks(
            asset,
            key,
            recipes=recipes,
            recipients=recipients,
            fpr=fpr,
            jobs=jobs,
            progress=progress,
        )
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
        recipients=spellings(recipients),
        fpr=fpr,
        n_schemes=evidence.n_schemes,
        notes=evidence.notes,
    )
    elapsed = evidence.elapsed_s + time.perf_counter() - start
    verdict = replace(verdict, elapsed_s=elapsed)
    return verdict if evidence.authenticated else without_weight(verdict)
