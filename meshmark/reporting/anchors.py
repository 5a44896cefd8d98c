"""Points at which the carriers of blind schemes stand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from meshmark.arrays import IntArray
from meshmark.errors import CapacityError, InputError
from meshmark.extension.recipe import Recipe
from meshmark.mesh.animation import Frame
from meshmark.mesh.breakdown import breakdown_means_no_capacity
from meshmark.mesh.welding import Welding


def anchors_of(frame: Frame, recipes: Sequence[Recipe]) -> IntArray:
    """Find the points of a frame, (a,) int, at which carriers of some schemes stand.

    Those of informed schemes stand everywhere, and some of others at no point.
    """
    found: set[int] = set()
    welding = Welding.of(frame)
    for recipe in recipes:
        if recipe.informed:
            continue
        try:
            with breakdown_means_no_capacity():
                vertices = recipe.build().observe(welding.frame(frame)).vertices
        except (CapacityError, InputError):
            continue
        if vertices is not None:
            found.update(welding.kept[vertices].tolist())
    return np.array(sorted(found), dtype=np.int64)
