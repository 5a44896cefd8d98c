"""The original in poses that it never takes, as a copy of the same vertices shows them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix, diags_array, eye_array
from scipy.sparse.linalg import SuperLU, splu

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import lengths
from meshmark.mesh.topology import Topology, polygon_edges

# How far neighbourhoods reach, squared, in edges: wider ones follow joints less, and narrower
# ones follow what stands out of the surface, too.
REACH_SQUARED = 1.0 / 3.0
# Pull towards the map of the whole, as a share of a neighbourhood's spread: what is flat has no
# map of its own across.
RIDGE = 1e-6
# This share of the edges is stretched by less than that in another pose.
MOST, STRETCHED = 0.75, 0.1


def is_posed_anew(V: FloatArray, Q: FloatArray, topology: Topology) -> bool:
    """Tell whether a copy's vertices Q (N, 3) may be those of a surface in another pose.

    Most edges keep their lengths when joints turn, but for the scale that all share.
    """
    E, _ = polygon_edges(topology.counts, topology.indices)
    before, after = (lengths(P[E[:, 1]] - P[E[:, 0]]) for P in (V, Q))
    stretch = np.full(len(E), np.inf)
    np.divide(after, before, out=stretch, where=before > 0.0)
    scale = float(np.median(stretch))
    if not 0.0 < scale < np.inf:
        return False
    return bool(np.quantile(np.abs(stretch / scale - 1.0), MOST) < STRETCHED)


def is_mirrored(V: FloatArray, Q: FloatArray, F: IntArray) -> bool:
    """Tell whether a surface (N, 3) in another pose Q is a mirror image.

    Joints that turn leave the sign of the volume that it encloses, as far as it does.
    """
    volume = [np.linalg.det((P - P.mean(axis=0))[F]).sum() for P in (V, Q)]
    return bool(volume[0] * volume[1] < 0.0)


def reposed(V: FloatArray, Q: FloatArray, topology: Topology) -> FloatArray:
    """Bend a surface to where a copy has its vertices, but not to how they stand out of it.

    Every vertex goes where the affine map that suits its neighbourhood best takes it.

    Parameters
    ----------
    V : (N, 3) float64
        Vertices of the surface.
    Q : (N, 3) float64
        Where the copy has them.
    topology : Topology
        Of both; their neighbours are those along its edges.

    Returns
    -------
    (N, 3) float64

    References
    ----------
    S. Schaefer, T. McPhail, J. Warren, "Image deformation using moving least squares", ACM
    Transactions on Graphics 25(3), 2006. doi:10.1145/1141911.1141920
    """
    centre = V.mean(axis=0)
    X = (V - centre) / (float(np.abs(V - centre).max()) or 1.0)
    whole = np.column_stack([np.ones(len(X)), X])
    whole = whole @ np.linalg.lstsq(whole, Q, rcond=None)[0]
    Y, mean = Q - whole, _neighbourhood_means(topology)
    x, y = mean(X), mean(Y)
    S = mean(X[:, :, None] * X[:, None, :]) - x[:, :, None] * x[:, None, :]
    T = mean(X[:, :, None] * Y[:, None, :]) - x[:, :, None] * y[:, None, :]
    spread = np.maximum(np.trace(S, axis1=1, axis2=2), np.finfo(np.float64).tiny)
    S += RIDGE * spread[:, None, None] * np.eye(3)
    return whole + y + np.einsum("ni,nij->nj", X - x, np.linalg.solve(S, T))


class _Means:
    """Weighted means over the neighbourhood of every vertex."""

    def __init__(self, topology: Topology) -> None:
        E, _ = polygon_edges(topology.counts, topology.indices)
        N = topology.n_points
        i, j = np.concatenate([E, E[:, ::-1]]).T
        A = csr_matrix((np.ones(len(i)), (i, j)), shape=(N, N))
        L = diags_array(np.asarray(A.sum(axis=1)).ravel()) - A
        self._solver: SuperLU = splu(csc_matrix(eye_array(N) + REACH_SQUARED * L))

    def __call__(self, x: FloatArray) -> FloatArray:
        """Average values (N, ...)."""
        return self._solver.solve(x.reshape(len(x), -1)).reshape(x.shape)


@lru_cache(maxsize=4)
def _neighbourhood_means(topology: Topology) -> _Means:
    """Remembered for the topologies used last."""
    return _Means(topology)
