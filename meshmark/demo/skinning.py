"""Skin weights from the flesh on each bone, and dual quaternion skinning."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from meshmark.arrays import FloatArray, IntArray
from meshmark.demo.flesh import Capsule
from meshmark.demo.skeleton import Skeleton
from meshmark.mesh.topology import vertex_adjacency

# Weights fall by 1/e over this fraction of the flesh's radius, so that a hip bends over a longer
# stretch than a fetlock, and then diffuse over the surface by so many umbrella half-steps on a
# mesh of the reference size: the length they go is the same on every mesh.
_FALLOFF = 1.0
_DIFFUSION_ROUNDS = 36
_SETTLING_ROUNDS = 8
_REFERENCE_POINTS = 7000


def skin_weights(
    V: FloatArray, F: IntArray, skeleton: Skeleton, flesh: tuple[Capsule, ...]
) -> FloatArray:
    """Weigh how much each bone carries each vertex.

    A vertex follows the bone whose flesh is nearest, and those up to two steps up or down its
    chain, so that skin does not follow a limb that merely passes by; the weights are then
    diffused over the surface, so that joints bend over a length.

    Parameters
    ----------
    V : (N, 3) float64
        Rest positions.
    F : (F, 3) int
        Triangles.
    skeleton : Skeleton
        The bones.
    flesh : tuple of Capsule
        What hangs on them.

    Returns
    -------
    (N, B) float64
        Weights, each row sums to 1.
    """
    distance = np.full((len(V), len(skeleton)), np.inf)
    for capsule in flesh:
        b = skeleton.index[capsule.bone]
        radius = max(capsule.radius_a, capsule.radius_b)
        distance[:, b] = np.minimum(distance[:, b], capsule.distance(V)[0] / radius)
    nearest = distance.argmin(axis=1)
    excess = distance - distance[np.arange(len(V)), nearest, None]
    W = np.exp(-excess / _FALLOFF) * _related(skeleton)[nearest]
    W /= W.sum(axis=1, keepdims=True)
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


def _related(skeleton: Skeleton) -> NDArray[np.bool_]:
    """Tell which bones are at most two steps up or down one chain from each other, (B, B)."""
    bones = len(skeleton)
    up = np.zeros((bones, bones), dtype=bool)
    child = np.flatnonzero(skeleton.parents >= 0)
    up[child, skeleton.parents[child]] = True
    up |= up @ up
    return np.eye(bones, dtype=bool) | up | up.T


def skin(
    V: FloatArray, F: IntArray, W: FloatArray, rotations: FloatArray, translations: FloatArray
) -> FloatArray:
    """Move the skin with the bones by blending dual quaternions, and let creases open.

    Parameters
    ----------
    V : (N, 3) float64
        Rest positions.
    F : (F, 3) int
        Triangles.
    W : (N, B) float64
        Weights.
    rotations : (T, B, 3, 3) float64
        Rotation of each bone away from rest.
    translations : (T, B, 3) float64
        Its translation.

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
    frames, bones = rotations.shape[:2]
    turns = Rotation.from_matrix(rotations.reshape(-1, 3, 3))
    real = turns.as_quat(canonical=True).reshape(frames, bones, 4)
    dual = np.concatenate([real, _dual_part(real, translations)], axis=2)
    blended = np.einsum("nb,tbq->tnq", W, dual, optimize=True)
    blended /= np.linalg.norm(blended[..., :4], axis=2, keepdims=True)
    posed = _turn(blended[..., :4], V) + _shift(blended)
    smooth = _diffuse(posed.transpose(1, 0, 2).reshape(len(V), -1), F, _SETTLING_ROUNDS)
    detail = V - _diffuse(V, F, _SETTLING_ROUNDS)
    settled: FloatArray = smooth.reshape(len(V), frames, 3).transpose(1, 0, 2)
    return settled + _turn(blended[..., :4], detail)


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


def _turn(real: FloatArray, X: FloatArray) -> FloatArray:
    """Rotate vectors by unit quaternions (x, y, z, w)."""
    vector, scalar = real[..., :3], real[..., 3:]
    return X + 2 * np.cross(vector, np.cross(vector, X) + scalar * X)


def _shift(dual: FloatArray) -> FloatArray:
    """Return the translations of unit dual quaternions."""
    r, w, d, e = dual[..., :3], dual[..., 3:4], dual[..., 4:7], dual[..., 7:]
    return 2 * (w * d - e * r + np.cross(r, d))
