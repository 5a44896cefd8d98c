"""Skins: vertices that follow several joints, each by its weight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import InputError
from meshmark_plugins.readers.gltf.accessors import Accessors
from meshmark_plugins.readers.gltf.element import Element
from meshmark_plugins.readers.gltf.geometry import Vertices

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


@dataclass(frozen=True, eq=False)
class Skin:
    """The joints of a skin.

    Parameters
    ----------
    joints : tuple of int
        Nodes.
    inverse_bind : (J + 1, 4, 4) float64
        From the space that the mesh is bound in to that of each joint; and the identity for the
        node of the mesh itself.
    """

    joints: tuple[int, ...]
    inverse_bind: FloatArray


@dataclass(frozen=True, eq=False)
class Binding:
    """How a mesh hangs on a skin.

    Parameters
    ----------
    vertices : Vertices
        With joints, by their numbers in the skin, and weights of any sum.
    inverse_bind : (J + 1, 4, 4) float64
        That of the skin. The node of the mesh, which is the last, carries vertices that no joint
        does.
    """

    vertices: Vertices
    inverse_bind: FloatArray

    @cached_property
    def weights(self) -> csr_matrix:
        """Weights of the joints, and of the node, (N, J + 1); each row's sum is 1."""
        # Imported here: who only reads a file has read it in less time.
        from scipy.sparse import csr_matrix

        weights = self.vertices.weights.astype(np.float64)
        total = weights.sum(axis=1)
        still = np.abs(total) < np.finfo(np.float32).tiny
        weights /= np.where(still, 1.0, total)[:, None]
        weights[still] = 0.0
        weights = np.column_stack([weights, still])
        joints = np.pad(self.vertices.joints.astype(np.int64), ((0, 0), (0, 1)))
        joints[:, -1] = len(self.inverse_bind) - 1
        # What has no weight may name anything.
        used = weights != 0
        ends = np.concatenate([[0], np.cumsum(used.sum(axis=1))])
        shape = len(weights), len(self.inverse_bind)
        return csr_matrix((weights[used], joints[used], ends), shape=shape)

    def listed(self) -> tuple[IntArray, FloatArray]:
        """List the joints of each vertex, and their weights, (N, n); 0 where there are fewer."""
        counts = np.diff(self.weights.indptr)
        used = np.arange(counts.max(initial=0)) < counts[:, None]
        joints, weights = np.zeros(used.shape, dtype=np.int64), np.zeros(used.shape)
        joints[used], weights[used] = self.weights.indices, self.weights.data
        return joints, weights

    def blended(self, worlds: FloatArray) -> FloatArray:
        """Return the matrix of each vertex, (N, 3, 4); see `skinned`."""
        moves = (worlds @ self.inverse_bind)[:, :3].reshape(-1, 12)
        return (self.weights @ moves).reshape(-1, 3, 4)

    def skinned(self, points: FloatArray, worlds: FloatArray) -> FloatArray:
        """Move points by linear blend skinning.

        Parameters
        ----------
        points : (N, 3) float64
            In the space that they are bound in.
        worlds : (J + 1, 4, 4) float64
            Where the joints stand, and the node of the mesh, in world space.

        Returns
        -------
        (N, 3) float64
            In world space.
        """
        blended = self.blended(worlds)
        return np.einsum("nij,nj->ni", blended[:, :, :3], points) + blended[:, :, 3]


def read_skin(skin: Element, nodes: Sequence[object], accessors: Accessors) -> Skin:
    """Read a skin.

    Raises
    ------
    InputError
        If it has no joints, or fewer matrices than joints.
    """
    joints = skin.indices("joints", nodes)
    if not joints:
        skin.fail("joints", "is missing or empty")
    # The last is that of the node.
    inverse_bind = np.empty((len(joints) + 1, 4, 4))
    inverse_bind[:] = np.eye(4)
    if "inverseBindMatrices" in skin:
        index = skin.index("inverseBindMatrices", accessors.elements)
        n = accessors.count(index)
        if n < len(joints):
            skin.fail("inverseBindMatrices", f"are {n}, but there are {len(joints)} joints")
        columns = accessors.numbers(index, 16, count=n)[: len(joints)]
        inverse_bind[:-1] = columns.reshape(-1, 4, 4).transpose(0, 2, 1)
    return Skin(joints, inverse_bind)


def bind(vertices: Vertices, skin: Skin) -> Binding:
    """Bind vertices to a skin.

    Raises
    ------
    InputError
        If a vertex names a joint that the skin does not have.
    """
    n = len(skin.joints)
    joints = vertices.joints
    if joints.size and joints.max() >= n:
        # What has no weight may name anything.
        wrong = (joints >= n) & (vertices.weights != 0)
        if wrong.any():
            row = int(np.argmax(wrong.any(axis=1)))
            named = joints[wrong].max()
            raise InputError(f"vertex {row} follows joint {named} of a skin of {n} joints")
    return Binding(vertices, skin.inverse_bind)
