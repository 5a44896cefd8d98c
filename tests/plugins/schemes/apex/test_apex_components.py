"""Components of a mesh, and the root areas in which they are measured."""

from __future__ import annotations

import numpy as np

from meshmark.testing.meshes import capsule, side_by_side
from meshmark_plugins.schemes.apex.anchors.components import (
    large_components,
    reference_root_area,
    shared_root_areas,
)


def without_top(V, F, height):
    below = F[(V[F, 2] < height).all(axis=1)]
    kept, faces = np.unique(below, return_inverse=True)
    return V[kept], faces.reshape(-1, 3)


def test_open_components_and_the_largest_share_a_root_area_and_closed_ones_have_their_own():
    large, small = capsule(24, 60), capsule(20, 50, 0.2, 2.0)
    V, F = side_by_side(large, (small[0] + 5.0, small[1]))
    own = shared_root_areas(V, large_components(V, F))
    assert own[0] > 1.4 * own[1]
    cut = without_top(*small, 0.5)
    V, F = side_by_side(large, (cut[0] + 5.0, cut[1]))
    shared = shared_root_areas(V, large_components(V, F))
    assert shared[0] == shared[1] == reference_root_area(V, F) > own[0]
