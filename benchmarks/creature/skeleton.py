"""The creature's bones at rest, and what turning their joints does to them.

Lengths are centimetres; X points forward, Y up, Z to the creature's right.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from meshmark.arrays import FloatArray, IntArray

Point = tuple[float, float, float]

SIDES = {"left": -1.0, "right": 1.0}


@dataclass(frozen=True)
class Bone:
    """A rigid piece from `head`, the joint it turns about, to `tail`, both in the rest pose."""

    name: str
    parent: str | None
    head: Point
    tail: Point


@dataclass(frozen=True)
class Skeleton:
    """Bones, parents before children."""

    bones: tuple[Bone, ...]

    def __len__(self) -> int:
        return len(self.bones)

    @cached_property
    def index(self) -> dict[str, int]:
        """Position of each bone by name."""
        return {bone.name: i for i, bone in enumerate(self.bones)}

    @cached_property
    def parents(self) -> IntArray:
        """Position of each bone's parent, (B,) int; -1 for the root."""
        return np.array([-1 if b.parent is None else self.index[b.parent] for b in self.bones])

    @cached_property
    def heads(self) -> FloatArray:
        """Joint positions in the rest pose, (B, 3)."""
        return np.array([bone.head for bone in self.bones])

    def pose(self, pitch: FloatArray, yaw: FloatArray, shift: FloatArray) -> FloatArray:
        """Turn the joints: forward kinematics for all frames at once.

        Parameters
        ----------
        pitch : (T, B) float64
            Turn of each bone relative to its parent about Z, radians; positive swings a
            hanging leg forward.
        yaw : (T, B) float64
            Turn about Y, radians, applied before the pitch.
        shift : (T, 3) float64
            Translation of the root.

        Returns
        -------
        (T, B, 8) float64
            Motion of each bone away from its rest pose, a unit dual quaternion: real part
            (x, y, z, w), w >= 0, then dual part.
        """
        local = _about_z(pitch) @ _about_y(yaw)
        rotations = np.empty_like(local)
        translations = np.empty((*pitch.shape, 3))
        for b, parent in enumerate(self.parents):
            joint = self.heads[b]
            if parent < 0:
                rotations[:, b] = local[:, b]
                anchor = joint + shift
            else:
                rotations[:, b] = rotations[:, parent] @ local[:, b]
                anchor = rotations[:, parent] @ joint + translations[:, parent]
            translations[:, b] = anchor - rotations[:, b] @ joint
        turns = Rotation.from_matrix(rotations.reshape(-1, 3, 3))
        real = turns.as_quat(canonical=True).reshape(*pitch.shape, 4)
        return np.concatenate([real, _dual_part(real, translations)], axis=2)


def _dual_part(real: FloatArray, shift: FloatArray) -> FloatArray:
    """Encode translations beside rotations (x, y, z, w): half the product of both, (..., 4)."""
    vector, scalar = real[..., :3], real[..., 3:]
    return np.concatenate(
        [
            0.5 * (scalar * shift + np.cross(shift, vector)),
            -0.5 * np.sum(shift * vector, axis=-1, keepdims=True),
        ],
        axis=-1,
    )


def _about_z(angle: FloatArray) -> FloatArray:
    c, s, o, i = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    rows = [np.stack(r, axis=-1) for r in ((c, -s, o), (s, c, o), (o, o, i))]
    return np.stack(rows, axis=-2)


def _about_y(angle: FloatArray) -> FloatArray:
    c, s, o, i = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    rows = [np.stack(r, axis=-1) for r in ((c, o, s), (o, i, o), (-s, o, c))]
    return np.stack(rows, axis=-2)


# Axial bones lie in the plane of symmetry: name, parent, joint (x, y), end (x, y).
_AXIAL: tuple[tuple[str, str | None, tuple[float, float], tuple[float, float]], ...] = (
    ("loin", None, (-12, 124), (-28, 126)),
    ("pelvis", "loin", (-28, 126), (-62, 126)),
    ("thorax", "loin", (2, 122), (48, 118)),
    ("neck_low", "thorax", (46, 122), (68, 146)),
    ("neck_high", "neck_low", (68, 146), (90, 170)),
    ("head", "neck_high", (90, 170), (128, 140)),
    ("tail_1", "pelvis", (-70, 130), (-86, 127)),
    ("tail_2", "tail_1", (-86, 127), (-101, 117)),
    ("tail_3", "tail_2", (-101, 117), (-113, 101)),
    ("tail_4", "tail_3", (-113, 101), (-122, 82)),
)

# Paired bones: name, parent, joint and end as (x, y, distance from the plane of symmetry). A
# parent is looked for on the same side first.
_PAIRED: tuple[tuple[str, str, Point, Point], ...] = (
    ("ear", "head", (88, 178, 4.5), (88, 197, 8)),
    ("scapula", "thorax", (36, 136, 10), (60, 104, 14)),
    ("humerus", "scapula", (60, 104, 14), (45, 85, 15)),
    ("radius", "humerus", (45, 85, 15), (48, 48, 13)),
    ("fore_cannon", "radius", (48, 48, 13), (47, 20, 12.5)),
    ("fore_pastern", "fore_cannon", (47, 20, 12.5), (54, 8, 12.5)),
    ("fore_hoof", "fore_pastern", (54, 8, 12.5), (60, 0, 12.5)),
    ("femur", "pelvis", (-50, 114, 12), (-36, 86, 17)),
    ("tibia", "femur", (-36, 86, 17), (-68, 54, 14)),
    ("hind_cannon", "tibia", (-68, 54, 14), (-62, 20, 13)),
    ("hind_pastern", "hind_cannon", (-62, 20, 13), (-55, 8, 13)),
    ("hind_hoof", "hind_pastern", (-55, 8, 13), (-49, 0, 13)),
)


def creature_skeleton() -> Skeleton:
    """Build the creature's skeleton at rest: standing square, tail half raised."""
    bones = [Bone(name, parent, (*head, 0.0), (*tail, 0.0)) for name, parent, head, tail in _AXIAL]
    paired = {name for name, *_ in _PAIRED}
    for side, sign in SIDES.items():
        for name, parent, head, tail in _PAIRED:
            above = f"{parent}_{side}" if parent in paired else parent
            bones.append(Bone(f"{name}_{side}", above, mirrored(head, sign), mirrored(tail, sign)))
    return Skeleton(tuple(bones))


def mirrored(point: Point, sign: float) -> Point:
    """Place a paired point on one side of the plane of symmetry."""
    x, y, z = point
    return (x, y, sign * z)
