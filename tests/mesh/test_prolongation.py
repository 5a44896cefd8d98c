"""Where vertices lie on a coarse mesh: in the closest triangle about their own sample."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.mesh.closest_in_triangle import closest_in_triangle
from meshmark.mesh.geometry import lengths
from meshmark.mesh.prolongation import prolongation
from meshmark.mesh.topology import edges
from meshmark.testing.meshes import icosphere


def distances_to_fan(V, samples, faces, vertex, sample):
    """Distance of a vertex from each triangle about a sample."""
    fan = faces[(faces == sample).any(axis=1)]
    a, b, c = (V[samples[corner]] for corner in fan.T)
    P = np.repeat(V[vertex][None], len(fan), axis=0)
    u, v, w = closest_in_triangle(P, a, b, c).T[:, :, None]
    return lengths(u * a + v * b + w * c - P)


@pytest.mark.parametrize("flattened", [False, True])
def test_each_vertex_lies_in_the_closest_triangle_of_its_fan(flattened):
    coarse, faces = icosphere(1)
    rng = np.random.default_rng(2)
    # Points beside and off the surface, some of them nearest to an edge or a corner.
    nearest = rng.integers(0, len(coarse), 800)
    points = coarse[nearest] + rng.normal(scale=0.4, size=(800, 3))
    if flattened:
        # Triangles without area have no plane, and there are ties.
        coarse = coarse * [1.0, 0.0, 0.0]
    V, samples = np.concatenate([coarse, points]), np.arange(len(coarse))
    nearest = np.concatenate([samples, nearest])
    P = prolongation(V, samples, faces, nearest)
    assert P.data.min() >= 0.0
    np.testing.assert_allclose(P.sum(axis=1), 1.0)
    gaps = lengths(P @ V[samples] - V)
    np.testing.assert_allclose(gaps[: len(coarse)], 0.0, atol=1e-12)
    for vertex in range(len(coarse), len(V), 7):
        least = distances_to_fan(V, samples, faces, vertex, nearest[vertex]).min()
        assert gaps[vertex] == pytest.approx(least, abs=1e-9)
    # In a triangle about its own sample, which need not be the closest of all.
    corners = P.indices.reshape(-1, 3)
    assert (corners == nearest[:, None]).any(axis=1).all()
    joined = {tuple(edge) for edge in edges(faces).tolist()}
    assert all(tuple(sorted(row[:2])) in joined for row in corners.tolist())
