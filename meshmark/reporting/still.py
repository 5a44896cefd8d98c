"""A picture of the view, for readers and printers that show no 3D."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import normalized, vertex_normals
from meshmark.mesh.open3d_import import load_open3d
from meshmark.reporting.camera import ANGLE, ASPECT, Camera
from meshmark.reporting.colours import PLAIN, STEPS, heat_colours, rgb, rgb_of
from meshmark.reporting.png import png
from meshmark.reporting.view import View

HEIGHT = 440
WIDTH = round(HEIGHT * ASPECT)
# Rays through each pixel, in each direction.
RAYS = 2
# Light from everywhere, and from the right, above and behind the camera.
AMBIENT, LIGHT = 0.52, np.array([0.35, 0.55, 0.76])


def still(view: View) -> bytes:
    """Render the first frame of a view as PNG, coloured like the view is at first."""
    V, F = view.positions[0], view.faces
    colours = np.tile(rgb(PLAIN), (len(V), 1))
    if view.heat is not None:
        colours = rgb_of(heat_colours())[heat_steps(view)[0]]
    o3d = load_open3d()
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(V.astype(np.float32), F.astype(np.uint32))
    hit = scene.cast_rays(o3d.core.Tensor(_rays(view.camera)))
    face = hit["primitive_ids"].numpy().astype(np.int64)
    seen = np.isfinite(hit["t_hit"].numpy())
    u, v = hit["primitive_uvs"].numpy()[seen].T.astype(np.float64)
    weights, corners = np.stack([1 - u - v, u, v], axis=1), F[face[seen]]
    picture = np.zeros((*seen.shape, 4))
    shade = _shade(_at(vertex_normals(V, F), corners, weights), view.camera)
    picture[seen, :3] = np.minimum(255.0, _at(colours.astype(np.float64), corners, weights) * shade)
    picture[seen, 3] = 255.0
    return png(_smaller(picture))


def heat_steps(view: View) -> IntArray:
    """Return the colour of every value of a view, (T, n) int from 0 to `STEPS` - 1."""
    assert view.heat is not None
    shares = np.clip(view.heat.values / view.heat.top, 0.0, 1.0)
    return np.rint((STEPS - 1) * shares).astype(np.int64)


def _rays(camera: Camera) -> NDArray[np.float32]:
    """List origin and direction of each ray, (height, width, 6)."""
    slope = np.tan(np.radians(ANGLE) / 2)
    height, width = HEIGHT * RAYS, WIDTH * RAYS
    y = slope * (1 - 2 * (np.arange(height) + 0.5) / height)
    x = slope * ASPECT * (2 * (np.arange(width) + 0.5) / width - 1)
    local = np.stack([*np.broadcast_arrays(x[None, :], y[:, None], -1.0)], axis=-1)
    directions = local @ camera.axes
    origins = np.broadcast_to(camera.position, directions.shape)
    return np.concatenate([origins, directions], axis=-1).astype(np.float32)


def _at(values: FloatArray, corners: IntArray, weights: FloatArray) -> FloatArray:
    """Interpolate values of vertices (n, 3) in triangles."""
    mixed: FloatArray = np.einsum("ij,ijk->ik", weights, values[corners])
    return mixed


def _shade(normals: FloatArray, camera: Camera) -> FloatArray:
    """Return how bright surfaces are, (n, 1), from either side."""
    facing = normalized(normals) @ camera.axes.T
    facing = np.where(facing[:, 2:] < 0, -facing, facing)
    light = LIGHT / np.linalg.norm(LIGHT)
    return AMBIENT + (1.08 - AMBIENT) * np.maximum(0.0, facing @ light)[:, None]


def _smaller(picture: FloatArray) -> NDArray[np.uint8]:
    """Average the rays of each pixel, colours by how much of it they cover."""
    blocks = picture.reshape(HEIGHT, RAYS, WIDTH, RAYS, 4)
    opacity = blocks[..., 3].mean(axis=(1, 3))
    weights = blocks[..., 3:] / np.maximum(blocks[..., 3:].sum(axis=(1, 3), keepdims=True), 1.0)
    colours = (blocks[..., :3] * weights).sum(axis=(1, 3))
    return np.rint(np.concatenate([colours, opacity[..., None]], axis=-1)).astype(np.uint8)
