"""How the creature's skin follows its bones: dual quaternion skinning."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.topology import vertex_adjacency

# Weights diffuse over the surface by so many umbrella half-steps on a mesh of the reference size:
# the length they go is the same on every mesh. Diffused weights would treble the shipped data.
_DIFFUSION_ROUNDS = 36
_SETTLING_ROUNDS = 8
_REFERENCE_POINTS = 7000


def skin_weights(nearness: FloatArray, F: IntArray) -> FloatArray:
    """Weigh how much each bone carries each vertex.

    How near the bones are is diffused over the surface, so that joints bend over a length.

    Parameters
    ----------
    nearness : (N, B) float64
        How near each bone is to each vertex, 0 to 1.
    F : (F, 3) int
        Triangles.

    Returns
    -------
    (N, B) float64
        Weights, each row sums to 1.
    """
    W = nearness / nearness.sum(axis=1, keepdims=True)
    smooth = _diffuse(W, F, _DIFFUSION_ROUNDS)
    return smooth / smooth.sum(axis=1, keepdims=True)


def _diffuse(X: FloatArray, F: IntArray, rounds: int) -> FloatArray:
    """Average every vertex's row with its neighbours', again and again.

    A round reaches an edge's length, and diffusion goes with its square root: as many more
    rounds as there are points keep the reach.
    """
    A = vertex_adjacency(F, len(X))
    degree = np.asarray(A.sum(axis=1)).reshape(-1, 1)
    for _ in range(max(1, round(rounds * len(X) / _REFERENCE_POINTS))):
        X = 0.5 * (X + A @ X / degree)
    return X


def skin(V: FloatArray, F: IntArray, W: FloatArray, bones: FloatArray) -> FloatArray:
    """Move the skin with the bones by blending dual quaternions, and let creases open.

    Parameters
    ----------
    V : (N, 3) float64
        Rest positions.
    F : (F, 3) int
        Triangles.
    W : (N, B) float64
        Weights.
    bones : (T, B, 8) float64
        Motion of each bone away from rest, a unit dual quaternion: real part (x, y, z, w), then
        dual part.

    Returns
    -------
    (T, N, 3) float64
        Posed positions.

    Notes
    -----
    Dual quaternion linear blending [1]_: limbs keep their girth where a linear blend of matrices
    pinches them. All rotations stay within half a turn of rest, so their quaternions, taken with
    a positive real part, lie in one hemisphere. Delta mush [2]_ then smooths the posed skin and
    gives back the detail that the same smoothing took from the rest pose: skin that the bones
    folded over itself at a flexed joint spreads out.

    References
    ----------
    .. [1] L. Kavan et al., "Geometric skinning with approximate dual quaternion blending",
       ACM TOG 27(4), 2008, https://doi.org/10.1145/1409625.1409627
    .. [2] J. Mancewicz et al., "Delta mush: smoothing deformations while preserving detail",
       DigiPro 2014, https://doi.org/10.1145/2633374.2633376
    """
    blended = np.einsum("nb,tbq->tnq", W, bones, optimize=True)
    blended /= np.linalg.norm(blended[..., :4], axis=2, keepdims=True)
    posed = _turn(blended[..., :4], V) + _shift(blended)
    smooth = _diffuse(posed.transpose(1, 0, 2).reshape(len(V), -1), F, _SETTLING_ROUNDS)
    detail = V - _diffuse(V, F, _SETTLING_ROUNDS)
    settled: FloatArray = smooth.reshape(len(V), len(bones), 3).transpose(1, 0, 2)
    return settled + _turn(blended[..., :4], detail)


def _turn(real: FloatArray, X: FloatArray) -> FloatArray:
    """Rotate vectors by unit quaternions (x, y, z, w)."""
    vector, scalar = real[..., :3], real[..., 3:]
    return X + 2 * np.cross(vector, np.cross(vector, X) + scalar * X)


def _shift(dual: FloatArray) -> FloatArray:
    """Return the translations of unit dual quaternions."""
    r, w, d, e = dual[..., :3], dual[..., 3:4], dual[..., 4:7], dual[..., 7:]
    return 2 * (w * d - e * r + np.cross(r, d))
