"""Frame ranges as artists type them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from meshmark.errors import UsageError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset, LeftOut

# Stands for "as many frames as it takes".
AUTO = "auto"


def frames_in(animation: MeshAnimation, text: str | None) -> tuple[int, ...]:
    """Return the indices of the frames in a range A:B[:S] of time codes.

    A mesh that has no time, because its points are not sampled, is the same at all times: its one
    frame lies in every range.

    Parameters
    ----------
    text : str or None
        A and B are time codes, both included, either may be empty; S keeps every S-th of the
        frames in between. None and "auto" stand for all.

    Raises
    ------
    UsageError
        If the text is not a range, or no frame lies in it.
    """
    if text is None or text == AUTO:
        return tuple(range(len(animation)))
    first, last, stride = _parse(text)
    within = (animation.times >= first) & (animation.times <= last)
    inside = np.flatnonzero(np.isnan(animation.times) | within)[::stride]
    if inside.size == 0:
        raise UsageError(
            f"no frame lies in {text}; there are {len(animation)}, "
            f"from {animation.times[0]:g} to {animation.times[-1]:g}",
            source=animation.origin,
            prim=animation.prim,
        )
    return tuple(int(i) for i in inside)


def spread(n_frames: int, most: int) -> list[int]:
    """Choose at most so many frames, evenly spaced, the first and the last included."""
    return sorted({*np.linspace(0, n_frames - 1, min(most, n_frames)).round().astype(int).tolist()})


def has_frame_in(animation: MeshAnimation, text: str | None) -> bool:
    """Tell whether an animation has a frame in a range; see `frames_in`."""
    try:
        return len(frames_in(animation, text)) > 0
    except UsageError:
        return False


def in_range(asset: Asset, text: str | None) -> tuple[Asset, tuple[LeftOut, ...]]:
    """Leave out the meshes of an asset that have no frame in a range; see `frames_in`.

    Raises
    ------
    UsageError
        If the text is not a range, or no mesh has a frame in it.
    """
    empty: dict[str, UsageError] = {}
    for mesh in asset.meshes:
        try:
            frames_in(mesh, text)
        except UsageError as error:
            empty[mesh.prim] = error
    kept = tuple(mesh for mesh in asset.meshes if mesh.prim not in empty)
    if not kept:
        raise next(iter(empty.values()))
    left_out = tuple(LeftOut(prim, error.message) for prim, error in empty.items())
    return replace(asset, meshes=kept), left_out


def _parse(text: str) -> tuple[float, float, int]:
    fields = text.split(":")
    try:
        if len(fields) not in (2, 3):
            raise ValueError
        first = float(fields[0]) if fields[0] else -np.inf
        last = float(fields[1]) if fields[1] else np.inf
        stride = int(fields[2]) if len(fields) == 3 else 1
        if stride < 1 or not first <= last:
            raise ValueError
    except ValueError:
        raise UsageError(
            f"a frame range is A:B or A:B:S with A <= B and S >= 1, not {text!r}"
        ) from None
    return first, last, stride
