"""How high a relief may be: by what is seen of it, by thickness, and by the triangles."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.flip_guard import allowed_shares
from meshmark.mesh.geometry import area_vectors, lengths, normalized, surface_box, vertex_normals
from meshmark.mesh.open3d_import import load_open3d

# Most of the distance to the next surface, inwards and outwards, that a height may take.
THICKNESS_SHARE = 0.05
# Rays begin so far off their surface, as a share of the diagonal: in single precision they would
# hit it otherwise.
LIFT = 2e-5
# A face may turn by this cosine (20 degrees) before its corners are held back.
LEAST_COSINE = 0.94


def slope(V: FloatArray, F: IntArray, f: FloatArray) -> float:
    """Root mean square over the area of the slope of heights f (N,), in radians for small ones."""
    N = area_vectors(V, F)
    area = lengths(N)
    n = normalized(N)
    # The gradient of a linear function on a triangle is the sum of its values times opposite sides,
    # turned by a right angle, over twice the area.
    total = np.zeros_like(N)
    for k in range(3):
        side = V[F[:, (k + 2) % 3]] - V[F[:, (k + 1) % 3]]
        total += f[F[:, k], None] * np.cross(n, side)
    square = np.divide(lengths(total), 2.0 * area, out=np.zeros(len(F)), where=area > 0.0) ** 2
    # Slivers have no slope to speak of; their few would outweigh all others.
    most = np.quantile(square, 0.99)
    return float(np.sqrt((area * np.minimum(square, most)).sum() / area.sum()))


def room(V: FloatArray, F: IntArray) -> FloatArray:
    """Highest relief that the distance to the next surface leaves each vertex, (N,) float64."""
    o3d = load_open3d()
    diagonal, centre = surface_box(V, F)
    local, n = (V - centre) / diagonal, vertex_normals(V, F)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(local.astype(np.float32), F.astype(np.uint32))
    free = np.full(len(V), np.inf)
    for direction in (n, -n):
        rays = np.hstack([local + LIFT * direction, direction]).astype(np.float32)
        free = np.minimum(free, scene.cast_rays(rays)["t_hit"].numpy().astype(np.float64))
    return THICKNESS_SHARE * diagonal * free


def allowed(V: FloatArray, F: IntArray, f: FloatArray) -> FloatArray:
    """Share of its height that each vertex may keep, (N,), so that no face turns too far."""
    moved = V + f[:, None] * vertex_normals(V, F)
    return allowed_shares(V, moved, F, least_cosine=LEAST_COSINE)
