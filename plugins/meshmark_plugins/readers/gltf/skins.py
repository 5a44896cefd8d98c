"""Skins: vertices that follow several joints, each by its weight."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import InputError
from meshmark_plugins.readers.gltf.accessors import Accessors
from meshmark_plugins.readers.gltf.element import Element
from meshmark_plugins.readers.gltf.geometry import Vertices


@dataclass(frozen=True, eq=False)
class Skin:
    """The joints of a skin.

    Parameters
    ----------
    joints : tuple of int
        Nodes.
    inverse_bind : (J, 4, 4) float64
        From the space that the mesh is bound in to that of each joint.
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
        That of the skin; and the identity for the node of the mesh itself, which carries vertices
        that no joint does.
    """

    vertices: Vertices
    inverse_bind: FloatArray

    @cached_property
    def weights(self) -> FloatArray:
        """Return the weights of the joints, and then of the node, (N, W + 1) of sum 1."""
        weights = self.vertices.weights.astype(np.float64)
        total = weights.sum(axis=1)
        still = np.abs(total) < np.finfo(np.float32).tiny
        weights /= np.where(still, 1.0, total)[:, None]
        weights[still] = 0.0
        return np.column_stack([weights, still.astype(np.float64)])

    @cached_property
    def joints(self) -> IntArray:
        """Return the numbers of the joints, and then of the node, (N, W + 1)."""
        joints = np.where(self.vertices.weights != 0, self.vertices.joints, 0)
        node = np.full((len(joints), 1), len(self.inverse_bind) - 1)
        return np.hstack([joints.astype(np.int64), node])

    def blended(self, worlds: FloatArray) -> FloatArray:
        """Return the matrix of each vertex, (N, 3, 4); see `skinned`."""
        moves = (worlds @ self.inverse_bind)[:, :3]
        blended = np.zeros((len(self.joints), 3, 4))
        for joints, weights in zip(self.joints.T, self.weights.T, strict=True):
            if weights.any():
                blended += weights[:, None, None] * moves[joints]
        return blended

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
        return (blended[:, :, :3] @ points[:, :, None])[:, :, 0] + blended[:, :, 3]


def read_skin(skin: Element, nodes: tuple[object, ...], accessors: Accessors) -> Skin:
    """Read a skin.

    Raises
    ------
    InputError
        If it has no joints, or fewer matrices than joints.
    """
    joints = skin.indices("joints", nodes)
    if not joints:
        skin.fail("joints", "is missing or empty")
    inverse_bind = np.tile(np.eye(4), (len(joints), 1, 1))
    if "inverseBindMatrices" in skin:
        index = skin.index("inverseBindMatrices", accessors.elements)
        n = accessors.count(index)
        if n < len(joints):
            skin.fail("inverseBindMatrices", f"are {n}, but there are {len(joints)} joints")
        columns = accessors.numbers(index, 16, count=n)[: len(joints)]
        inverse_bind = columns.astype(np.float64).reshape(-1, 4, 4).transpose(0, 2, 1)
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
    return Binding(vertices, np.concatenate([skin.inverse_bind, np.eye(4)[None]]))
