"""Rough placements by principal axes, mirror images included."""

from __future__ import annotations

from itertools import product

import numpy as np

from meshmark.alignment.copy_frames import CopyFrame
from meshmark.alignment.pose_samples import Moments, PoseSamples
from meshmark.alignment.refinement import Placement
from meshmark.mesh.closest_points import sample_surface

SIGNS = [np.array(signs) for signs in product((1.0, -1.0), repeat=3)]
POINTS = 300
# Poses tried for each choice of signs; the next best is at least so many sampled poses away.
POSES_EACH, APART = 2, 3


def by_axes(frame: CopyFrame, samples: PoseSamples) -> list[Placement]:
    """List placements that put principal axes on principal axes, the best first.

    Parameters
    ----------
    frame : CopyFrame
    samples : PoseSamples

    Returns
    -------
    list of Placement
        A few poses for each of the eight choices of directions.
    """
    own = Moments(frame.points, frame.faces)
    if own.radius == 0.0:
        return []
    P = sample_surface(frame.points, frame.faces, POINTS, np.random.default_rng(0))
    found: list[tuple[float, Placement]] = []
    for signs in SIGNS:
        misfits, starts = [], []
        for at, there in enumerate(samples.moments):
            R = there.radius / own.radius * (there.axes * signs) @ own.axes.T
            A = np.column_stack([R, there.centre - R @ own.centre])
            starts.append(Placement(A, float(samples.poses[at])))
            misfits.append(samples.misfit(starts[-1](P), at))
        left = np.array(misfits)
        for _ in range(POSES_EACH):
            at = int(left.argmin())
            if not np.isfinite(left[at]):
                break
            found.append((misfits[at], starts[at]))
            left[max(0, at - APART + 1) : at + APART] = np.inf
    return [placement for _, placement in sorted(found, key=lambda each: each[0])]
