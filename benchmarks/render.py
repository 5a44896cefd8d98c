"""Pictures of a mesh by ray casting: for the documentation, and for a look without a window."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import UsageError
from meshmark.mesh.open3d_import import load_open3d

Image = NDArray[np.uint8]

# Colours of points, given their faces and barycentric coordinates.
Paint = Callable[[IntArray, FloatArray], FloatArray]

CLAY = (0.72, 0.68, 0.62)

# Fractions of full light, linear.
_AMBIENT = 0.25
_KEY = 0.75
_FILL = 0.20
_SHADOW = 0.45
_GAMMA = 2.2


@dataclass(frozen=True)
class View:
    """An orthographic camera, Y up, that looks at a point.

    Parameters
    ----------
    azimuth : float
        Degrees about the vertical; 0 looks along -Z (X points right), 90 looks along -X.
    elevation : float
        Degrees above the horizon.
    center : (3,) float, optional
        Point in the middle of the picture; the middle of the bounding box if not given.
    span : float, optional
        Width of the picture in the unit of the points; fitted to the mesh if not given.
    up_axis : str
        "Y" or "Z".
    """

    azimuth: float = 20.0
    elevation: float = 12.0
    center: tuple[float, float, float] | None = None
    span: float | None = None
    up_axis: str = "Y"

    def axes(self) -> FloatArray:
        """Return the picture's right, up and towards-the-eye directions, rows of (3, 3)."""
        a, e = np.radians([self.azimuth, self.elevation])
        back = np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])
        right = np.array([np.cos(a), 0.0, -np.sin(a)])
        frame = np.stack([right, np.cross(back, right), back])
        if self.up_axis == "Z":
            # A quarter turn about X takes Y-up to Z-up.
            frame = frame @ np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
        return frame


def render_frame(
    V: FloatArray,
    F: IntArray,
    *,
    colors: ArrayLike | Paint | None = None,
    view: View | None = None,
    size: tuple[int, int] = (960, 640),
    samples: int = 2,
) -> Image:
    """Ray-cast one frame: Lambert shading with a key light, a fill light and a shadow on itself.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    F : (F, 3) int
        Triangles.
    colors : (F, 3) float, or callable, optional
        Colour of each face, 0 to 1; or what returns the colours (n, 3) of points, given their faces
        (n,) and barycentric coordinates (n, 3). Clay if not given.
    view : View, optional
        Camera; a slightly raised three-quarter view fitted to the mesh if not given. Give
        `center` and `span` to hold the camera still over an animation.
    size : (int, int)
        Width and height in pixels.
    samples : int
        Rays per pixel along each axis (antialiasing).

    Returns
    -------
    (height, width, 3) uint8
        The picture, first row on top.

    Raises
    ------
    UsageError
        If there is not one colour for each face, or the size is not positive.
    """
    width, height = size
    if width < 1 or height < 1 or samples < 1:
        raise UsageError("a picture needs a positive size and at least one sample a pixel")
    paint = colors if callable(colors) else _by_face(F, colors)
    view = view or View()
    axes = view.axes()
    origins = _camera_rays(V, axes, view, (width * samples, height * samples))
    studio = _Studio(V, F, axes)
    hit, points, uv = studio.first_hit(origins)
    picture = np.ones((len(origins), 3))
    seen = hit >= 0
    normals = _normals_at(V, F, hit[seen], uv[seen])
    weights = np.column_stack([1 - uv[seen].sum(axis=1), uv[seen]])
    picture[seen] = paint(hit[seen], weights) * studio.light(points[seen], normals)[:, None]
    picture = picture.reshape(height, samples, width, samples, 3).mean(axis=(1, 3))
    return np.round(255.0 * np.clip(picture, 0.0, 1.0) ** (1.0 / _GAMMA)).astype(np.uint8)


def _by_face(F: IntArray, colors: ArrayLike | None) -> Paint:
    shades = np.asarray(CLAY if colors is None else colors, dtype=np.float64)
    shades = np.broadcast_to(shades, (len(F), 3)) if colors is None else shades
    if shades.shape != (len(F), 3):
        raise UsageError(f"colors must be ({len(F)}, 3), one for each face, not {shades.shape}")
    return lambda face, _: shades[face]


def _camera_rays(V: FloatArray, axes: FloatArray, view: View, grid: tuple[int, int]) -> FloatArray:
    """Return where the rays start, (rays, 3), outside the mesh, top row first."""
    width, height = grid
    low, high = V.min(axis=0), V.max(axis=0)
    center = (low + high) / 2 if view.center is None else np.asarray(view.center)
    seen = (V - center) @ axes.T
    if view.span is None:
        half = 1.08 * max(np.abs(seen[:, 0]).max(), np.abs(seen[:, 1]).max() * width / height)
    else:
        half = view.span / 2
    x = (np.arange(width) + 0.5) / width * 2 - 1
    y = (1 - (np.arange(height) + 0.5) / height * 2) * height / width
    far = 2 * float(np.linalg.norm(high - low)) + float(np.abs(seen[:, 2]).max())
    X, Y = np.meshgrid(x * half, y * half)
    return center + X.reshape(-1, 1) * axes[0] + Y.reshape(-1, 1) * axes[1] + far * axes[2]


class _Studio:
    """A mesh and its lights: built once for a picture, asked for hits, light and shadow."""

    def __init__(self, V: FloatArray, F: IntArray, axes: FloatArray) -> None:
        o3d = load_open3d()
        self._tensor = o3d.core.Tensor
        self._scene = o3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(
            self._tensor(V.astype(np.float32)), self._tensor(F.astype(np.uint32))
        )
        self._toward_eye = axes[2]
        # Lights hang on the camera, so that every view shows the shape equally well.
        self._key = _unit(axes.T @ np.array([-0.45, 0.75, 0.55]))
        self._fill = _unit(axes.T @ np.array([0.8, 0.1, 0.4]))
        self._lift = 1e-3 * float(np.linalg.norm(np.ptp(V, axis=0)))

    def _cast(self, start: FloatArray, direction: FloatArray) -> dict[str, Any]:
        rays = np.concatenate([start, np.broadcast_to(direction, start.shape)], axis=1)
        answer = self._scene.cast_rays(self._tensor(rays.astype(np.float32)))
        return {name: value.numpy() for name, value in answer.items()}

    def first_hit(self, origins: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return the face seen by each ray (-1 for none), the point, and its place in the face."""
        answer = self._cast(origins, -self._toward_eye)
        distance = answer["t_hit"].astype(np.float64)
        seen = np.isfinite(distance)
        face = np.where(seen, answer["primitive_ids"].astype(np.int64), -1)
        points = origins - np.where(seen, distance, 0.0)[:, None] * self._toward_eye
        return face, points, answer["primitive_uvs"].astype(np.float64)

    def light(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return the light that falls on points of the mesh, (rays,)."""
        # A face seen from behind (an open or inverted mesh) is lit all the same.
        facing = normals * np.where(normals @ self._toward_eye < 0, -1.0, 1.0)[:, None]
        key = np.clip(facing @ self._key, 0, None)
        shadow = self._shadow(points + self._lift * facing)
        return (
            _AMBIENT
            + _FILL * np.clip(facing @ self._fill, 0, None)
            + _KEY * key * np.where(shadow, _SHADOW, 1.0)
        )

    def _shadow(self, points: FloatArray) -> NDArray[np.bool_]:
        return np.isfinite(self._cast(points, self._key)["t_hit"])


def _unit(vector: FloatArray) -> FloatArray:
    return vector / np.linalg.norm(vector)


def _normals_at(V: FloatArray, F: IntArray, face: IntArray, uv: FloatArray) -> FloatArray:
    """Interpolate the vertices' normals at points of faces, (rays, 3), unit."""
    area = np.cross(V[F[:, 1]] - V[F[:, 0]], V[F[:, 2]] - V[F[:, 0]])
    at_vertex = np.zeros_like(V)
    np.add.at(at_vertex, F.reshape(-1), np.repeat(area, 3, axis=0))
    weights = np.column_stack([1 - uv.sum(axis=1), uv])
    normals = np.einsum("rk,rkd->rd", weights, at_vertex[F[face]])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.where(length > 0, length, 1.0)
