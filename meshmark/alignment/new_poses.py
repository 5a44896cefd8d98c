"""Frames of a copy in poses that the original never takes, with its own vertices and faces."""

from __future__ import annotations

import numpy as np

from meshmark.alignment.copy_frames import CopyFrame
from meshmark.alignment.fit import FITS_PAIRED, KEPT, NEAR, WELL, Fit
from meshmark.alignment.joints import moved_by_joints
from meshmark.alignment.original import Original
from meshmark.alignment.poses import posed
from meshmark.alignment.procrustes import similarity
from meshmark.alignment.refinement import Placement
from meshmark.alignment.reposing import is_mirrored, is_posed_anew, reposed
from meshmark.arrays import FloatArray
from meshmark.mesh.geometry import lengths, vertex_normals
from meshmark.mesh.topology import Topology

# Joints that leave less than this share of what the nearest pose leaves have taken another one.
MUCH_BETTER = 0.5


def by_reposing(frame: CopyFrame, original: Original, topology: Topology) -> Fit | None:
    """Place a frame in another pose; None if it has other vertices or faces, or fits nowhere.

    Parameters
    ----------
    frame : CopyFrame
    original : Original
    topology : Topology
        Of the copy.
    """
    moved = _moved(frame, original, topology)
    if moved is None:
        return None
    placement, V, Q = moved
    bent = reposed(V, Q, original.welding.topology)
    distances = lengths(Q - bent) / original.diagonal
    near = float((distances < NEAR).mean())
    return Fit(placement, distances, near, near, 1.0)


def joints_fit_better(frame: CopyFrame, original: Original, topology: Topology, fit: Fit) -> bool:
    """Tell whether joints explain a frame much better than the original's pose in `fit` does."""
    if original.skinning is None or fit.residual < WELL:
        return False
    moved = _moved(frame, original, topology)
    if moved is None:
        return False
    placement, V, Q = moved
    # Vertices may slide along the surface.
    n = vertex_normals(V, original.welding.topology.triangles)
    heights = np.abs(np.einsum("ij,ij->i", Q - V, n)) / original.diagonal
    return Fit(placement, heights).residual < MUCH_BETTER * fit.residual


def _moved(
    frame: CopyFrame, original: Original, topology: Topology
) -> tuple[Placement, FloatArray, FloatArray] | None:
    """Place a frame roughly, and move the original there by its joints, if they are known.

    Returns
    -------
    placement : Placement
    V, Q : (M, 3) float64
        Welded vertices of the original, and where the copy has them.
    """
    pose = original.pose_of(frame) if frame.n_points == original.n_points else None
    if pose is None or not topology.same_as(original.animation[0].topology):
        return None
    there, kept = posed(original.animation, round(pose)).points, original.welding.kept
    # In another pose, a mirror image may come nearer, and turns what stands out inwards.
    Q = there.copy()
    Q[frame.vertices] = frame.points
    mirrors = is_mirrored(there[kept], Q[kept], original.welding.topology.triangles)
    P, ones = there[frame.vertices], np.ones(len(frame.points))
    placement = Placement(similarity(frame.points, P, ones, mirrors=mirrors), float(round(pose)))
    Q[frame.vertices] = placement(frame.points)
    V, Q = there[kept], Q[kept]
    if original.skinning is None:
        fits = is_posed_anew(V, Q, original.welding.topology)
    else:
        V = moved_by_joints(original.skinning, V, Q)
        apart = float(np.quantile(lengths(Q - V), KEPT))
        fits = apart <= FITS_PAIRED * original.diagonal
    return (placement, V, Q) if fits else None
