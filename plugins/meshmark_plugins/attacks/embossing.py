"""A random low relief on a surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.spatial import cKDTree

from meshmark.arrays import FloatArray
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.closest_points import sample_surface
from meshmark.mesh.geometry import face_areas, surface_box, vertex_areas
from meshmark_plugins.attacks.frames import naming, treat_frames
from meshmark_plugins.attacks.normals import welded_normals
from meshmark_plugins.attacks.parameters import number, whole

# Where a bump ends, in standard deviations: three ten-thousandths of its height are left there.
_REACH = 4.0


@dataclass(frozen=True)
class Embossing:
    """Raise and lower a surface along its normals by a smooth random field.

    Parameters
    ----------
    height : float
        Root mean square of the heights over the surface, as a fraction of the bounding box's
        diagonal, in [0, 0.1].
    patches : int
        Number of bumps, K, in [1, 100000]; each is about as large as a patch, sqrt(area / K).

    Raises
    ------
    UsageError
        If a parameter is out of range.

    Notes
    -----
    The field is sum_k w_k exp(-|x - s_k|^2 / 2 s^2): random signs w_k at points s_k spread evenly
    over the surface, with a standard deviation s of half a patch. With one connectivity, heights
    are those of the first frame's vertices in all frames, and rest on the moving surface.
    Otherwise every frame has its own.
    """

    height: float = 1e-4
    patches: int = 400

    def __post_init__(self) -> None:
        object.__setattr__(self, "height", number("embossing", "height", self.height, 0, 0.1))
        object.__setattr__(self, "patches", whole("embossing", "patches", self.patches, 1, 100_000))

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the embossed animation."""
        if not animation.constant_topology:
            return treat_frames(animation, EmbossFrame(self.height, self.patches), rng)
        first = animation[0]
        with naming(animation.origin, animation.prim, first.time):
            h = heights(first, self.height, self.patches, rng)
        return animation.map(Raise(h))


@dataclass(frozen=True)
class EmbossFrame:
    """Embosses one frame with a relief of its own."""

    height: float
    patches: int

    def __call__(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Return the embossed frame."""
        return Raise(heights(frame, self.height, self.patches, rng))(frame)


@dataclass(frozen=True, eq=False)
class Raise:
    """Moves the vertices of a frame by heights (N,) along the frame's own normals."""

    heights: FloatArray

    def __call__(self, frame: Frame) -> Frame:
        """Return the raised frame."""
        n = welded_normals(frame.points, frame.faces)
        return frame.moved(frame.points + self.heights[:, None] * n)


def heights(frame: Frame, height: float, patches: int, rng: np.random.Generator) -> FloatArray:
    """Draw the smooth heights of a frame's vertices.

    Parameters
    ----------
    height : float
        Their root mean square by area, over the diagonal.
    patches : int
        Number of bumps.

    Returns
    -------
    (N,) float64
        In the unit of the points; 0 for a mesh without area.
    """
    V, F = frame.points, frame.faces
    s = np.sqrt(face_areas(V, F).sum() / patches) / 2.0
    if s == 0.0:
        return np.zeros(len(V))
    bumps = sample_surface(V, F, patches, rng)
    signs = rng.choice([-1.0, 1.0], patches)
    near = cKDTree(V).sparse_distance_matrix(cKDTree(bumps), _REACH * s, output_type="coo_matrix")
    kernel = coo_matrix(
        (np.exp(-0.5 * (near.data / s) ** 2), (near.row, near.col)), shape=near.shape
    )
    h = kernel @ signs
    area = vertex_areas(V, F)
    rms = np.sqrt(area @ h**2 / area.sum())
    return h * (height * surface_box(V, F)[0] / rms) if rms else h
