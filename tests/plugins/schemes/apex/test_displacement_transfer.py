"""A displacement on the surface of other poses, and its fit to that surface."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from meshmark.mesh.closest_points import ClosestPoints
from meshmark.mesh.geometry import normalized
from meshmark.metrics.surface_distance import mrms
from meshmark.testing.meshes import icosphere, plane, torus
from meshmark_plugins.schemes.apex.marking.displacement_transfer import DisplacementTransfer
from meshmark_plugins.schemes.apex.marking.fit_to_surface import fit_to_surface

ROTATION = Rotation.from_rotvec([0.4, -1.1, 2.0]).as_matrix()


def test_a_displacement_is_laid_on_the_surface_and_turns_with_it():
    V, F = torus(60, 30)
    transfer = DisplacementTransfer(V, F)
    d = 0.005 * np.random.default_rng(1).normal(size=V.size)
    X, share, _ = transfer.apply(V, d, ClosestPoints(V, F))
    # Where a face would have turned over, moves were shortened, across the bend.
    assert share.min() >= 0.0
    assert np.mean(share == 1.0) > 0.9
    assert ClosestPoints(V, F).distances(X[share == 1.0]).max() < 1e-12
    turned, _, _ = transfer.apply(V @ ROTATION.T, d, ClosestPoints(V @ ROTATION.T, F))
    np.testing.assert_allclose(turned, X @ ROTATION.T, atol=1e-4)
    still, _, _ = transfer.apply(V, 0.0 * d, ClosestPoints(V, F))
    np.testing.assert_allclose(still, V, atol=1e-12)


def test_vertices_that_left_a_plane_return_along_its_normal():
    V, F = plane(21)
    bumps = 0.005 * np.random.default_rng(5).normal(size=len(V))
    off = V + bumps[:, None] * [0.0, 0.0, 1.0]
    flat, own = ClosestPoints(V, F), ClosestPoints(V, F).faces(V)
    back = fit_to_surface(off, F, flat, own)
    # But for the weight of staying.
    assert np.abs(back[:, 2]).max() < 0.03 * np.abs(bumps).max()
    np.testing.assert_array_equal(fit_to_surface(V, F, flat, own), V)


@pytest.mark.parametrize("level", [2, 3])
def test_a_fitted_polyhedron_is_nearer_to_its_sphere_than_an_inscribed_one(level):
    ball, (V, F) = icosphere(5), icosphere(level)
    surface = ClosestPoints(*ball)
    fitted = fit_to_surface(V, F, surface, surface.faces(V))
    assert mrms(*ball, fitted, F) < 0.3 * mrms(*ball, V, F)
    # Vertices go outwards only, and not beyond the deepest triangle's sag.
    height = np.linalg.norm(fitted, axis=1) - 1.0
    assert height.min() > 0.0
    assert height.max() < 1.0 - np.linalg.norm(V[F].mean(axis=1), axis=1).min()
    np.testing.assert_allclose(normalized(fitted), V, atol=0.01)
