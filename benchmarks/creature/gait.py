"""A gallop: how every joint turns over one stride."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from creature.skeleton import SIDES, Skeleton
from meshmark.arrays import FloatArray

# When each foot lands, as a fraction of the stride: a transverse gallop on the right lead, with
# the suspension after the leading fore foot has left the ground.
FOOTFALL = {"hind_left": 0.00, "hind_right": 0.12, "fore_left": 0.35, "fore_right": 0.49}

# Segment angles: degrees away from the rest pose in the plane of motion, positive forward, at
# phases of the leg's own stride (0: landing, 0.25: leaving the ground).
_PHASES = (0.0, 0.12, 0.25, 0.37, 0.50, 0.63, 0.76, 0.89)
_SEGMENTS = {
    "fore": {
        "scapula": (3, 7, 3, 5, 5, 7, 6, 4),
        "humerus": (15, -7, -17, -17, -3, 16, 24, 25),
        "radius": (18, -8, -26, -23, 14, 45, 48, 34),
        "fore_cannon": (23, -7, -37, -82, -90, -48, 14, 34),
        "fore_pastern": (29, 27, -47, -129, -149, -101, -20, 25),
        "fore_hoof": (6, 1, -42, -136, -161, -114, -33, 6),
    },
    "hind": {
        "femur": (14, -3, -15, -12, 5, 22, 28, 23),
        "tibia": (13, -15, -28, -40, -37, -19, 4, 17),
        "hind_cannon": (21, -7, -34, -50, -34, -3, 22, 29),
        "hind_pastern": (29, 25, -44, -101, -91, -44, 8, 30),
        "hind_hoof": (4, 1, -41, -113, -104, -60, -7, 11),
    },
}


@dataclass(frozen=True)
class Wave:
    """A quantity that goes up and down once a stride: mean + swing cos(2 pi (phase - peak))."""

    mean: float
    swing: float
    peak: float

    def at(self, phase: FloatArray) -> FloatArray:
        """Evaluate at phases of the stride."""
        return self.mean + self.swing * np.cos(2 * np.pi * (phase - self.peak))


# The back rounds in suspension (about phase 0.87) and stretches as the hind feet push off; the
# neck reaches down and out while the fore feet carry, and the head holds against it.
_PITCH = {
    "loin": Wave(0, 4, 0.22),
    "pelvis": Wave(1, 8, 0.90),
    "thorax": Wave(0, 4, 0.36),
    "neck_low": Wave(-6, 7, 0.98),
    "neck_high": Wave(-4, 4, 0.02),
    "head": Wave(8, 6, 0.48),
    "ear_left": Wave(8, 9, 0.30),
    "ear_right": Wave(8, 9, 0.38),
    "tail_1": Wave(-26, 12, 0.35),
    "tail_2": Wave(-4, 12, 0.50),
    "tail_3": Wave(6, 14, 0.65),
    "tail_4": Wave(6, 16, 0.80),
}
_YAW = {
    "tail_1": Wave(0, 6, 0.10),
    "tail_2": Wave(0, 8, 0.25),
    "tail_3": Wave(0, 9, 0.40),
    "tail_4": Wave(0, 10, 0.55),
    "thorax": Wave(0, 1.5, 0.45),
    "neck_low": Wave(0, 1.5, 0.95),
}


# The body surges as the hind feet drive, is highest in suspension, and bobs twice a stride
# (centimetres). The segment angles above were solved for this path, so that every standing hoof
# stays within 4 cm of the ground and goes back at much the same speed, 440 cm a stride.
_SURGE = Wave(0, 2, 0.15)
_RISE = Wave(-8.2, 3.9, 0.849)
_BOB = Wave(0, 1.9, 0.258)


def joint_angles(skeleton: Skeleton, phase: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Turn every joint of the skeleton for phases of the stride.

    Parameters
    ----------
    skeleton : Skeleton
        The bones.
    phase : (T,) float64
        Phases, 0 to 1 for one stride; periodic.

    Returns
    -------
    pitch, yaw : (T, B) float64
        Angles relative to the parent, radians.
    """
    pitch = np.zeros((len(phase), len(skeleton)))
    yaw = np.zeros_like(pitch)
    for name, wave in _PITCH.items():
        pitch[:, skeleton.index[name]] = wave.at(phase)
    for name, wave in _YAW.items():
        yaw[:, skeleton.index[name]] = wave.at(phase)
    for girdle, segments in _SEGMENTS.items():
        for side in SIDES:
            own = np.mod(phase - FOOTFALL[f"{girdle}_{side}"], 1.0)
            above = np.zeros_like(own)
            for bone, keys in segments.items():
                segment = _periodic(keys)(own)
                pitch[:, skeleton.index[f"{bone}_{side}"]] = segment - above
                above = segment
    return np.radians(pitch), np.radians(yaw)


def _periodic(keys: tuple[float, ...]) -> CubicSpline:
    return CubicSpline([*_PHASES, 1.0], [*keys, keys[0]], bc_type="periodic")


def root_shift(phase: FloatArray) -> FloatArray:
    """Carry the body over one stride.

    Parameters
    ----------
    phase : (T,) float64
        Phases of the stride.

    Returns
    -------
    (T, 3) float64
        Translation of the root, centimetres; the forward travel of the stride is left out.
    """
    shift = np.zeros((len(phase), 3))
    shift[:, 0] = _SURGE.at(phase)
    shift[:, 1] = _RISE.at(phase) + _BOB.at(2 * phase)
    return shift
