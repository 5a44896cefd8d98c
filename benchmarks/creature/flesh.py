"""The creature's flesh: tapered capsules on the bones, blended into one implicit surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from creature.skeleton import SIDES, Point, mirrored
from meshmark.arrays import FloatArray

# The soles are cut flat here, rounded over this length (centimetres).
SOLE_HEIGHT = 0.0
SOLE_ROUNDING = 3.0


@dataclass(frozen=True)
class Capsule:
    """A tapered capsule that moves with a bone.

    Parameters
    ----------
    bone : str
        Bone it hangs on.
    a, b : (3,) float
        Ends of its axis, rest pose.
    radius_a, radius_b : float
        Radii at the ends.
    flatness : float
        Width (along Z) over depth of the cross section.
    blend : float
        Length over which it melts into what is there already.
    """

    bone: str
    a: Point
    b: Point
    radius_a: float
    radius_b: float
    flatness: float
    blend: float

    def distance(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Measure the distance of points to the surface, negative inside, and its gradient.

        Exact for a round capsule without taper, first-order near the surface otherwise.

        Parameters
        ----------
        X : (N, 3) float64
            Points.

        Returns
        -------
        d : (N,) float64
            Distances.
        g : (N, 3) float64
            Their gradients.
        """
        a, axis = np.array(self.a), np.array(self.b) - np.array(self.a)
        scale = np.array([1.0, 1.0, 1.0 / self.flatness])
        along = (X - a) @ axis / float(axis @ axis)
        t = np.clip(along, 0.0, 1.0)
        away = (X - a - t[:, None] * axis) * scale
        length = np.sqrt(np.einsum("ij,ij->i", away, away)) + 1e-12
        taper = self.radius_b - self.radius_a
        unit = away / length[:, None] * scale
        # Between the ends t follows the point; there the nearest axis point and the radius move.
        slide = np.where((along > 0) & (along < 1), unit @ axis + taper, 0.0) / float(axis @ axis)
        return length - self.radius_a - t * taper, unit - slide[:, None] * axis

    def bounds(self, axes: FloatArray, margin: float) -> tuple[FloatArray, FloatArray]:
        """Bound the capsule, grown by a margin, along the columns of `axes`, low and high (3,)."""
        ends = np.array([self.a, self.b]) @ axes
        reach = max(self.radius_a, self.radius_b) + margin
        return ends.min(axis=0) - reach, ends.max(axis=0) + reach


# bone, end a, end b, radius at a, radius at b, flatness, blend
_AXIAL: tuple[tuple[str, Point, Point, float, float, float, float], ...] = (
    ("thorax", (4, 112, 0), (38, 110, 0), 26, 25, 0.80, 0),
    ("loin", (-34, 120, 0), (4, 113, 0), 17, 25.5, 0.88, 14),
    ("pelvis", (-58, 119, 0), (-38, 117, 0), 20, 21, 0.90, 14),
    ("pelvis", (-60, 128, 0), (-34, 130, 0), 12, 12, 0.95, 14),
    ("loin", (-34, 129, 0), (14, 129, 0), 12, 11, 0.90, 12),
    ("thorax", (14, 131, 0), (42, 134, 0), 11, 11, 0.65, 14),
    ("thorax", (46, 106, 0), (56, 112, 0), 19, 16, 0.82, 12),
    ("neck_low", (48, 121, 0), (70, 147, 0), 20, 14.5, 0.58, 14),
    ("neck_high", (70, 147, 0), (90, 169, 0), 14.5, 11, 0.58, 8),
    ("neck_low", (40, 140, 0), (64, 158, 0), 8, 7, 0.60, 12),
    ("neck_high", (64, 158, 0), (84, 176, 0), 7, 6.5, 0.60, 8),
    ("head", (93, 169, 0), (108, 156, 0), 11.5, 10, 0.68, 6),
    ("head", (108, 156, 0), (128, 139, 0), 9.8, 7.6, 0.76, 5),
    ("head", (94, 159, 0), (106, 150, 0), 8, 7.2, 0.70, 5),
    ("head", (128, 140, 0), (131, 135, 0), 7.4, 6.2, 0.86, 4),
    ("tail_1", (-68, 130, 0), (-86, 127, 0), 5.2, 5.2, 1.0, 8),
    ("tail_2", (-86, 127, 0), (-101, 117, 0), 5.2, 6.6, 1.0, 1.5),
    ("tail_3", (-101, 117, 0), (-113, 101, 0), 6.6, 6.2, 1.0, 1.5),
    ("tail_4", (-113, 101, 0), (-122, 82, 0), 6.2, 3.8, 1.0, 1.5),
)
_PAIRED: tuple[tuple[str, Point, Point, float, float, float, float], ...] = (
    ("ear", (88, 176, 5.0), (86, 190, 8.5), 6.2, 3.0, 1.0, 3),
    ("scapula", (38, 130, 11), (57, 107, 14), 11, 12, 0.60, 9),
    ("humerus", (57, 103, 14), (46, 88, 15), 12, 11, 0.60, 8),
    ("radius", (46, 86, 15), (48, 53, 13.2), 9.5, 5.4, 0.80, 7),
    ("radius", (48, 50, 13), (48, 47, 13), 5.7, 5.6, 0.95, 3),
    ("fore_cannon", (47.6, 46, 13), (47, 21, 12.5), 4.5, 4.2, 0.95, 4),
    ("fore_cannon", (46.5, 20, 12.5), (47, 19, 12.5), 5.0, 5.0, 0.95, 3),
    ("fore_pastern", (47, 19, 12.5), (53, 9, 12.5), 4.3, 4.6, 1.0, 3),
    ("fore_hoof", (53, 8.5, 12.5), (56, 2.0, 12.5), 5.0, 6.2, 1.0, 2),
    ("femur", (-50, 115, 9.5), (-42, 94, 15.5), 19, 13.5, 0.60, 9),
    ("femur", (-62, 115, 9.5), (-58, 100, 13.5), 13, 9, 0.75, 8),
    ("tibia", (-42, 90, 16.5), (-63, 60, 14.5), 12, 6, 0.66, 6),
    ("tibia", (-66.5, 56, 14), (-69, 58, 14), 6.0, 5.2, 0.90, 5),
    ("hind_cannon", (-67.5, 53, 14), (-62, 21, 13), 5.2, 4.4, 0.95, 4),
    ("hind_cannon", (-62.5, 20, 13), (-62, 19, 13), 5.1, 5.1, 0.95, 3),
    ("hind_pastern", (-62, 19, 13), (-56, 9, 13), 4.4, 4.6, 1.0, 3),
    ("hind_hoof", (-56, 8.5, 13), (-53, 2.0, 13), 5.0, 6.2, 1.0, 2),
)


def creature_flesh() -> tuple[Capsule, ...]:
    """List the creature's capsules, trunk first, in the order they are blended."""
    capsules = [Capsule(*row) for row in _AXIAL]
    for bone, a, b, *shape in _PAIRED:
        for side, sign in SIDES.items():
            capsules.append(Capsule(f"{bone}_{side}", mirrored(a, sign), mirrored(b, sign), *shape))
    return tuple(capsules)


def reach(flesh: tuple[Capsule, ...]) -> float:
    """Tell how far outside itself a capsule can still shape the surface."""
    return max(capsule.blend for capsule in flesh) + 1.0


def field(X: FloatArray, flesh: tuple[Capsule, ...]) -> tuple[FloatArray, FloatArray]:
    """Evaluate the implicit surface: negative inside, near it about the distance.

    Parameters
    ----------
    X : (N, 3) float64
        Points.
    flesh : tuple of Capsule
        Blended one after the other.

    Returns
    -------
    value : (N,) float64
        Field; a positive constant out of every capsule's reach.
    gradient : (N, 3) float64
        Its gradient.

    Notes
    -----
    Union by the quadratic smooth minimum, min(p, q) - h^2 k / 4 with
    h = max(k - |p - q|, 0) / k [1]_.

    References
    ----------
    .. [1] I. Quilez, "Smooth minimum", https://iquilezles.org/articles/smin/
    """
    margin = reach(flesh)
    value, slope = np.full(len(X), margin), np.zeros_like(X)
    for capsule in flesh:
        low, high = capsule.bounds(np.eye(3), margin)
        near = np.flatnonzero(np.all((low <= X) & (high >= X), axis=1))
        if near.size:
            d, g = capsule.distance(X[near])
            value[near], slope[near] = smooth_union(value[near], slope[near], d, g, capsule.blend)
    return cut_soles(X, value, slope)


def smooth_union(
    p: FloatArray, slope_p: FloatArray, q: FloatArray, slope_q: FloatArray, k: float
) -> tuple[FloatArray, FloatArray]:
    """Blend two fields and their gradients over the length k."""
    h = np.maximum(k - np.abs(p - q), 0.0) / max(k, 1e-9)
    share = np.where(q < p, 1.0 - 0.5 * h, 0.5 * h)[:, None]
    return np.minimum(p, q) - 0.25 * k * h * h, (1.0 - share) * slope_p + share * slope_q


def cut_soles(X: FloatArray, value: FloatArray, slope: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Take away what is below the ground, so that hooves stand flat."""
    up = np.broadcast_to(np.array([0.0, 1.0, 0.0]), X.shape)
    cut, slope = smooth_union(-value, -slope, X[:, 1] - SOLE_HEIGHT, up, SOLE_ROUNDING)
    return -cut, -slope
