"""Where the view is seen from first: its long side, from a little above, all of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray

# Vertical angle of view in degrees, and width over height.
ANGLE, ASPECT = 28.0, 1.5
# How far it turns from the long side, and rises, in degrees; and the room left about everything.
TURN, RISE, MARGIN = 24.0, 14.0, 1.05


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera that looks at the origin, Y up.

    Parameters
    ----------
    position : (3,) float64
    """

    position: FloatArray

    @property
    def axes(self) -> FloatArray:
        """Right, up and back, (3, 3)."""
        back = self.position / np.linalg.norm(self.position)
        right = np.cross([0.0, 1.0, 0.0], back)
        right = right / np.linalg.norm(right)
        return np.array([right, np.cross(back, right), back])


def camera_for(X: FloatArray) -> Camera:
    """Place a camera so that all points of all frames X (T, n, 3) are in the picture."""
    flat = X[0][:, [0, 2]] - X[0][:, [0, 2]].mean(axis=0)
    long = np.linalg.eigh(flat.T @ flat)[1][:, 1]
    # An axis has two directions: always the same one, whatever the last digits are.
    long = long if long[np.abs(long).argmax()] > 0 else -long
    turn, rise = np.radians(TURN), np.radians(RISE)
    level = np.cos(turn) * np.array([-long[1], long[0]]) + np.sin(turn) * long
    direction = np.array([np.cos(rise) * level[0], np.sin(rise), np.cos(rise) * level[1]])
    right, up, back = (X.reshape(-1, 3) @ Camera(direction).axes.T).T
    slope = np.tan(np.radians(ANGLE) / 2)
    distance = back + np.maximum(np.abs(right) / (slope * ASPECT), np.abs(up) / slope)
    return Camera(direction * MARGIN * float(distance.max()))
