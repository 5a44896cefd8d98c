"""Where marks lie on a surface: the parts that schemes see, and the anchors of their carriers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from meshmark.arrays import IntArray
from meshmark.errors import CapacityError, InputError
from meshmark.extension.recipe import Recipe
from meshmark.mesh.animation import Frame
from meshmark.mesh.breakdown import breakdown_means_no_capacity
from meshmark.mesh.components import surface_components


def parts_of(frame: Frame, recipes: Sequence[Recipe]) -> IntArray:
    """Label the triangles of an analysed frame, (F,) int.

    By the segmenter of the first scheme that needs one; else by connected surfaces.
    """
    for recipe in recipes:
        helpers = recipe.build_helpers()
        if "segmenter" in helpers:
            try:
                with breakdown_means_no_capacity():
                    return helpers["segmenter"].segment(frame.points, frame.faces)
            except CapacityError:
                continue
    return surface_components(frame.points, frame.faces)


def anchors_of(frame: Frame, recipes: Sequence[Recipe]) -> IntArray:
    """Find the vertices of an analysed frame, (a,) int, at which carriers of schemes stand.

    Those of informed schemes stand everywhere, and some of others at no vertex.
    """
    found: set[int] = set()
    for recipe in recipes:
        if recipe.informed:
            continue
        try:
            with breakdown_means_no_capacity():
                vertices = recipe.build().observe(frame).vertices
        except (CapacityError, InputError):
            continue
        if vertices is not None:
            found.update(vertices.tolist())
    return np.array(sorted(found), dtype=np.int64)
