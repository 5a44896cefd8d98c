"""What most frames of an animation have in common, so that single ones that differ are known."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Sequence

# Share of the frames that must be alike for the others to count as bad ones. Fewer, and it is an
# animation whose connectivity changes: a mark in a minority of the frames must not be passed over.
MOST = 0.9


def agreed(shapes: Sequence[Hashable | None]) -> tuple[int, tuple[int, ...]] | None:
    """Find the frames that differ from almost all others.

    Parameters
    ----------
    shapes : sequence
        For each frame something that equals that of frames of the same shape (the same faces
        over as many points); None for a frame that is no mesh.

    Returns
    -------
    (int, tuple of int) or None
        The first frame of the shape that almost all meshes have, and the frames that do not have
        it. None if there is no such shape.
    """
    counts = Counter(shape for shape in shapes if shape is not None)
    if not counts:
        return None
    shape, n = counts.most_common(1)[0]
    if n < MOST * counts.total():
        return None
    return shapes.index(shape), tuple(i for i, each in enumerate(shapes) if each != shape)
