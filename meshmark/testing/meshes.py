"""Meshes whose measures are known in closed form, for tests of plugins."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray

Mesh = tuple[FloatArray, IntArray]


def plane(n: int, side: float = 1.0) -> Mesh:
    """Build a square in the xy-plane, n by n vertices, row after row along x; open.

    Parameters
    ----------
    n : int
        Vertices along each side.
    side : float
        Length of the side.

    Returns
    -------
    V : (n^2, 3) float64
    F : (2 (n - 1)^2, 3) int64
        Facing +z; the diagonals alternate, so that no direction is favoured.
    """
    grid = np.arange(n * n).reshape(n, n)
    x, y = np.meshgrid(np.linspace(0.0, side, n), np.linspace(0.0, side, n))
    V = np.stack([x.ravel(), y.ravel(), np.zeros(n * n)], axis=1)
    a, b = grid[:-1, :-1].ravel(), grid[:-1, 1:].ravel()
    c, d = grid[1:, 1:].ravel(), grid[1:, :-1].ravel()
    even = ((np.arange(n - 1)[:, None] + np.arange(n - 1)) % 2 == 0).ravel()[:, None]
    first = np.where(even, np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1))
    second = np.where(even, np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1))
    return V, np.concatenate([first, second])


def icosphere(level: int, radius: float = 1.0) -> Mesh:
    """Build a sphere about the origin: an icosahedron split `level` times.

    Returns
    -------
    V : (10 * 4^level + 2, 3) float64
        On the sphere.
    F : (20 * 4^level, 3) int64
        Facing outwards.
    """
    V, F = _icosahedron()
    for _ in range(level):
        V, F = _split(V, F)
        V = V / np.linalg.norm(V, axis=1, keepdims=True)
    return radius * V, F


def torus(n_major: int, n_minor: int, major: float = 1.0, minor: float = 0.4) -> Mesh:
    """Build a torus about the z axis.

    Parameters
    ----------
    n_major, n_minor : int
        Vertices around the axis and around the tube.
    major, minor : float
        Radius of the tube's centre line and of the tube.

    Returns
    -------
    V : (n_major n_minor, 3) float64
    F : (2 n_major n_minor, 3) int64
        Facing outwards.
    """
    u = 2.0 * np.pi * np.arange(n_major) / n_major
    v = 2.0 * np.pi * np.arange(n_minor) / n_minor
    r = major + minor * np.cos(v)
    z = np.broadcast_to(minor * np.sin(v), (n_major, n_minor))
    V = np.stack([np.cos(u)[:, None] * r, np.sin(u)[:, None] * r, z], axis=2).reshape(-1, 3)
    index = np.arange(n_major * n_minor).reshape(n_major, n_minor)
    closed = np.pad(index, ((0, 1), (0, 1)), mode="wrap")
    return V, _strips(closed)


def cylinder(n_around: int, n_along: int, radius: float = 1.0, height: float = 4.0) -> Mesh:
    """Build a cylinder about the z axis from 0 to `height`, closed by flat caps.

    Returns
    -------
    V : (n_around n_along + 2, 3) float64
        Rings from bottom to top, then the centres of the caps.
    F : (2 n_around n_along, 3) int64
        Facing outwards.
    """
    return revolution(np.full(n_along, radius), np.linspace(0.0, height, n_along), n_around)


def dumbbell(n_around: int = 48, n_along: int = 96, neck: float = 0.3, length: float = 2.0) -> Mesh:
    """Join two unit spheres by a straight neck along the z axis.

    Parameters
    ----------
    n_around, n_along : int
        Vertices around the axis and along the profile.
    neck : float
        Radius of the neck, below 1.
    length : float
        Length of the neck between the two spheres.

    Returns
    -------
    V : (n_around n_along + 2, 3) float64
        The neck's middle is at the origin, its ends are at z = +- length / 2.
    F : (2 n_around n_along, 3) int64
        Facing outwards.
    """
    centre = length / 2.0 + np.sqrt(1.0 - neck**2)
    # By arc length: half of one sphere's profile, the neck, half of the other's.
    reach = np.pi - np.arcsin(neck)
    s = np.linspace(0.0, 2.0 * reach + length, n_along + 2)[1:-1]
    phi = np.where(s < reach, s, 2.0 * reach + length - s)
    on_neck = phi > reach
    side = np.where(s < reach, -1.0, 1.0)
    r = np.where(on_neck, neck, np.sin(phi))
    z = np.where(on_neck, s - reach - length / 2.0, side * (centre + np.cos(phi)))
    bottom_top = np.array([-centre - 1.0, centre + 1.0])
    return revolution(r, z, n_around, poles=bottom_top)


def capsule(n_around: int, n_along: int, radius: float = 0.3, length: float = 3.0) -> Mesh:
    """Close a tube along the z axis, `length` long, by half spheres of its own radius.

    Parameters
    ----------
    n_around, n_along : int
        Vertices around the axis and along the profile.

    Returns
    -------
    V : (n_around n_along + 2, 3) float64
        The middle is at the origin; the last two are the tips, at z = -+(length / 2 + radius).
    F : (2 n_around n_along, 3) int64
        Facing outwards.
    """
    # By arc length from the middle, so that vertices are spread evenly along the profile.
    half = 0.5 * (length + np.pi * radius)
    s = np.linspace(-half, half, n_along + 2)[1:-1]
    phi = np.clip((np.abs(s) - length / 2.0) / radius, 0.0, None)
    z = np.sign(s) * (np.minimum(np.abs(s), length / 2.0) + radius * np.sin(phi))
    tip = length / 2.0 + radius
    return revolution(radius * np.cos(phi), z, n_around, poles=np.array([-tip, tip]))


def bumpy_sphere(
    level: int,
    directions: FloatArray,
    height: float | FloatArray = 1.5,
    width: float | FloatArray = 0.3,
) -> Mesh:
    """Pull horns out of an icosphere of radius 1: one closed surface with a tip for each.

    Parameters
    ----------
    level : int
        See `icosphere`.
    directions : (k, 3) float64
        Where the horns are, as seen from the origin; of any length.
    height : float or (k,) float64
        Of the horns, above the sphere.
    width : float or (k,) float64
        Angle from a horn's axis at which its height is down to 1 / e.

    Returns
    -------
    V : (10 * 4^level + 2, 3) float64
        The tips are at (1 + height) times the unit directions, for horns well apart.
    F : (20 * 4^level, 3) int64
        Facing outwards.
    """
    V, F = icosphere(level)
    axes = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    angle = np.arccos(np.clip(V @ axes.T, -1.0, 1.0))
    r = 1.0 + (height * np.exp(-((angle / width) ** 2))).sum(axis=1)
    return r[:, None] * V, F


def bent_tube(
    n_around: int, n_along: int, radius: float = 0.3, length: float = 4.0, angle: float = np.pi / 2
) -> Mesh:
    """Bend a cylinder: a closed tube along an arc of given length and angle.

    Bending keeps distances along the centre line: `angle` 0 and any other give the same one.

    Returns
    -------
    V : (n_around n_along + 2, 3) float64
        Rings along the tube, then the centres of the caps.
    F : (2 n_around n_along, 3) int64
        Facing outwards.
    """
    V, F = cylinder(n_around, n_along, radius, length)
    if angle == 0.0:
        return V, F
    bend = length / angle
    theta = V[:, 2] / bend
    r = bend - V[:, 0]
    return np.stack([bend - r * np.cos(theta), V[:, 1], r * np.sin(theta)], axis=1), F


def revolution(
    radius: FloatArray, height: FloatArray, n_around: int, poles: FloatArray | None = None
) -> Mesh:
    """Turn a profile about the z axis into a surface, closed by a fan at each end.

    Parameters
    ----------
    radius, height : (m,) float64
        Profile, upwards.
    n_around : int
        Vertices of a ring; every other ring is turned by half a step.
    poles : (2,) float64, optional
        Height of the centre of the bottom and the top fan; by default they are flat.

    Returns
    -------
    V : (m n_around + 2, 3) float64
        Rings upwards, then the bottom and the top centre.
    F : (2 m n_around, 3) int64
        Facing outwards.
    """
    m = len(radius)
    turn = np.arange(n_around) + 0.5 * (np.arange(m) % 2)[:, None]
    angle = 2.0 * np.pi * turn / n_around
    r, z = radius[:, None], np.broadcast_to(height[:, None], angle.shape)
    rings = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=2).reshape(-1, 3)
    ends = np.array([height[0], height[-1]]) if poles is None else poles
    centres = np.stack([np.zeros(2), np.zeros(2), ends], axis=1)
    index = np.pad(np.arange(m * n_around).reshape(m, n_around), ((0, 0), (0, 1)), mode="wrap")
    even = (np.arange(m - 1) % 2 == 0)[:, None]
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    # The short diagonal of each cell, which leans with the turn of its rings.
    first = np.where(even[..., None], np.stack([a, b, d], 2), np.stack([a, b, c], 2))
    second = np.where(even[..., None], np.stack([b, c, d], 2), np.stack([a, c, d], 2))
    bottom, top = index[0], index[-1]
    low = np.full(n_around, m * n_around)
    caps = [
        np.stack([low, bottom[1:], bottom[:-1]], axis=1),
        np.stack([low + 1, top[:-1], top[1:]], axis=1),
    ]
    F = np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3), *caps])
    return np.concatenate([rings, centres]), F.astype(np.int64)


def side_by_side(*meshes: Mesh) -> Mesh:
    """Join meshes into one of several components, as they stand."""
    offsets = np.cumsum([0] + [len(V) for V, _ in meshes])[:-1]
    V = np.concatenate([V for V, _ in meshes])
    F = np.concatenate([F + n for (_, F), n in zip(meshes, offsets, strict=True)])
    return V, F


def _strips(index: IntArray) -> IntArray:
    """Two triangles for each cell of a grid of vertex indices (m + 1, n + 1)."""
    a, b = index[:-1, :-1].ravel(), index[1:, :-1].ravel()
    c, d = index[1:, 1:].ravel(), index[:-1, 1:].ravel()
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def _split(V: FloatArray, F: IntArray) -> Mesh:
    """Split each triangle into four at the middle of its edges."""
    half = np.sort(np.concatenate([F[:, [0, 1]], F[:, [1, 2]], F[:, [2, 0]]]), axis=1)
    E, inverse = np.unique(half, axis=0, return_inverse=True)
    ab, bc, ca = len(V) + inverse.reshape(3, -1)
    a, b, c = F.T
    quarters = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
    return np.concatenate([V, V[E].mean(axis=1)]), np.concatenate(
        [np.stack(corners, axis=1) for corners in quarters]
    )


def _icosahedron() -> Mesh:
    """Build the unit icosahedron: two poles, and rings of five at latitudes +-atan(1/2)."""
    angle = 2.0 * np.pi * np.arange(5) / 5.0
    r, z = 2.0 / np.sqrt(5.0), 1.0 / np.sqrt(5.0)
    upper = np.stack([r * np.cos(angle), r * np.sin(angle), np.full(5, z)], axis=1)
    lower = np.stack(
        [r * np.cos(angle + np.pi / 5), r * np.sin(angle + np.pi / 5), np.full(5, -z)], axis=1
    )
    V = np.concatenate([[[0.0, 0.0, 1.0]], upper, lower, [[0.0, 0.0, -1.0]]])
    i, j = np.arange(5), (np.arange(5) + 1) % 5
    top, bottom = np.zeros(5, dtype=np.int64), np.full(5, 11)
    F = np.concatenate(
        [
            np.stack([top, 1 + i, 1 + j], axis=1),
            np.stack([1 + i, 6 + i, 1 + j], axis=1),
            np.stack([1 + j, 6 + i, 6 + j], axis=1),
            np.stack([bottom, 6 + j, 6 + i], axis=1),
        ]
    )
    return V, F.astype(np.int64)
