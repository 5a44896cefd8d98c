"""Labels of least energy: alpha expansion, each step one exact minimum cut."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from meshmark.arrays import FloatArray, IntArray

LARGEST_CAPACITY = 2**30
"""Capacities are rounded to int32, the only type scipy's flow takes."""

MAX_PASSES = 20


def expand(cost: FloatArray, pairs: IntArray, weight: FloatArray) -> IntArray:
    """Choose labels that minimise sum_i cost[i, l_i] + sum_ij weight_ij [l_i != l_j].

    Parameters
    ----------
    cost : (n, k) float64
        Cost of each label at each node.
    pairs : (m, 2) int
        Neighbouring nodes.
    weight : (m,) float64
        Cost of a difference between them, not negative.

    Returns
    -------
    (n,) int64
        Labels: the global minimum for k = 2, else at most twice its energy above it [1]_.

    References
    ----------
    .. [1] Y. Boykov, O. Veksler, R. Zabih, "Fast approximate energy minimization via graph
       cuts", IEEE PAMI 23 (2001). doi:10.1109/34.969114
    """
    n, k = cost.shape
    labels = np.zeros(n, dtype=np.int64)
    energy = _energy(labels, cost, pairs, weight)
    unimproved, alpha = 0, 0
    for _ in range(MAX_PASSES * k):
        alpha = (alpha + 1) % k
        proposal = _expansion(alpha, labels, cost, pairs, weight)
        proposed = _energy(proposal, cost, pairs, weight)
        improved = proposed < energy
        if improved:
            labels, energy = proposal, proposed
        # From all 0, the expansion of 1 already is the best of all two-labellings.
        unimproved = 0 if improved else unimproved + 1
        if k <= 2 or unimproved == k:
            break
    return labels


def _energy(labels: IntArray, cost: FloatArray, pairs: IntArray, weight: FloatArray) -> float:
    differ = labels[pairs[:, 0]] != labels[pairs[:, 1]]
    return float(cost[np.arange(len(labels)), labels].sum() + weight[differ].sum())


def _expansion(
    alpha: int, labels: IntArray, cost: FloatArray, pairs: IntArray, weight: FloatArray
) -> IntArray:
    """Let every node keep its label or take alpha, whichever costs least together."""
    n = len(labels)
    i, j = pairs.T
    take, keep = cost[:, alpha], cost[np.arange(n), labels]
    # What a pair costs if neither takes alpha, if only j, if only i; nothing if both do. With
    # x = 1 for a taker that is a + (q - p - a)/2 x_i + (p - q - a)/2 x_j + (p + q - a)/2 [x_i
    # != x_j], and the last factor is not negative: a sum that a cut can pay.
    a = np.where(labels[i] != labels[j], weight, 0.0)
    p = np.where(labels[i] != alpha, weight, 0.0)
    q = np.where(labels[j] != alpha, weight, 0.0)
    gain = take - keep
    gain += np.bincount(i, weights=(q - p - a) / 2.0, minlength=n)
    gain += np.bincount(j, weights=(p - q - a) / 2.0, minlength=n)
    return np.where(_takers(gain, pairs, (p + q - a) / 2.0), alpha, labels)


def _takers(gain: FloatArray, pairs: IntArray, weight: FloatArray) -> NDArray[np.bool_]:
    """Minimise sum_i gain_i x_i + sum_ij weight_ij [x_i != x_j] over x in {0, 1}."""
    n = len(gain)
    largest = max(float(np.abs(gain).sum()), float(weight.max(initial=0.0)))
    scale = LARGEST_CAPACITY / largest if largest > 0.0 else 0.0
    # The source's side has x = 0; a node that gains nothing by x = 1 is tied to it.
    terminal = np.round(gain * scale).astype(np.int64)
    source, sink = n, n + 1
    stays, goes = np.flatnonzero(terminal > 0), np.flatnonzero(terminal < 0)
    start = np.concatenate([np.full(len(stays), source), goes, *pairs.T])
    end = np.concatenate([stays, np.full(len(goes), sink), *pairs.T[::-1]])
    between = np.round(weight * scale).astype(np.int64)
    capacity = np.concatenate([terminal[stays], -terminal[goes], between, between])
    G = csr_matrix((capacity.astype(np.int32), (start, end)), shape=(n + 2, n + 2))
    residual = G - maximum_flow(G, source, sink).flow
    residual.data = np.maximum(residual.data, 0)
    residual.eliminate_zeros()
    # What the source still reaches is the smallest of the minimum cuts: there is only one.
    reached = breadth_first_order(residual, source, return_predecessors=False)
    x = np.ones(n + 2, dtype=np.bool_)
    x[reached] = False
    return x[:n]
