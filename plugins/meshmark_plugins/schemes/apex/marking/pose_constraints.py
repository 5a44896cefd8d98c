"""What each pose asks of a displacement: linear constraints on its chips."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np
from scipy.sparse import csr_matrix, diags_array, vstack

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.animation import MeshAnimation
from meshmark_plugins.schemes.apex.anchors.geodesic_field import GeodesicField
from meshmark_plugins.schemes.apex.chips.soft_chips import (
    ATTACK_NOISE,
    MIN_VERTEX_COUNT,
    SINE_VARIANCE,
)
from meshmark_plugins.schemes.apex.marking.displacement_transfer import DisplacementTransfer
from meshmark_plugins.schemes.apex.marking.gradients import (
    chip_jacobian,
    distance_directions,
    slide_field,
)
from meshmark_plugins.schemes.apex.marking.marked_anchors import MarkedAnchors, field_chips
from meshmark_plugins.schemes.apex.marking.solve_displacement import LinearConstraints
from meshmark_plugins.schemes.apex.parameters import Parameters

# Price of a chip's shortfall beside moving a vertex by a bin's width; above some 1, chips that
# contradict each other distort the mesh for nothing.
SHORTFALL_PRICE = 0.5
# Vertices of a bin at which its chip weighs half of what it can, and its target is `strength`.
HALF_WEIGHT_COUNT = 100.0
# A chip of very few vertices is driven no farther than this, in strengths.
MAX_TARGET_RATIO = 1.25


@dataclass(frozen=True, eq=False)
class PoseFields:
    """Distances from the anchors in a pose.

    Parameters
    ----------
    fields : list of ((m,) int, GeodesicField)
        By component, with which of the marked anchors each has.
    """

    fields: list[tuple[IntArray, GeodesicField]]

    def slide(self, X: FloatArray) -> PoseFields:
        """Carry the distances along with vertices that have slid a little, to X (N, 3)."""
        return PoseFields(
            [(rows, slide_field(field, X[field.component.vertices])) for rows, field in self.fields]
        )


@dataclass(frozen=True, eq=False)
class MeasuredChips:
    """The chips about the anchors of one component.

    Parameters
    ----------
    rows : (m,) int
        Which of the marked anchors these are.
    s, n : (m, K) float64
        Chips, and the effective number of vertices of each.
    J : (m K, 3 N) sparse float64
        Derivatives of the chips.
    """

    rows: IntArray
    s: FloatArray
    n: FloatArray
    J: csr_matrix


# What is asked, the frame and the displacement it is asked about, and what is known of the pose.
PoseTask = tuple[Literal["constraints", "shares"], int, FloatArray, Any]


@dataclass(frozen=True, eq=False)
class PoseConstraints:
    """Measures displacements in poses of an animation; picklable, for worker processes.

    Parameters
    ----------
    animation : MeshAnimation
        Frames as analysis sees them, of one topology.
    transfer : DisplacementTransfer
        Transfers displacements to them.
    anchors : MarkedAnchors
        The anchors and their units.
    words : (C, K) int
        Word of each anchor.
    parameters : Parameters
        Bins and strength.
    pose_vertices : mapping of (C,) int
        Where the anchors are detected in each pose, by frame.
    """

    animation: MeshAnimation
    transfer: DisplacementTransfer
    anchors: MarkedAnchors
    words: IntArray
    parameters: Parameters
    pose_vertices: Mapping[int, IntArray]

    # Whether distances of a pose that were measured once serve any displacement of it.
    distances_last: ClassVar[bool] = False

    def __call__(self, task: PoseTask) -> Any:
        """Do what is asked about a frame and a displacement; see the methods of that name."""
        asked, index, d, fields = task
        return self.shares(index, d) if asked == "shares" else self.constraints(index, d, fields)

    def shares(self, index: int, d: FloatArray) -> FloatArray:
        """Find how much of its move frame `index` leaves each vertex, (N,)."""
        P = self.animation[index].points
        return self.transfer.apply(P, d, self.transfer.closest_points(P))[1]

    def constraints(
        self, index: int, d: FloatArray, fields: Any = None
    ) -> tuple[LinearConstraints, Any]:
        """Apply a displacement to frame `index`, and find what its chips still lack.

        Parameters
        ----------
        index : int
            The frame.
        d : (3 N,) float64
            The displacement, in root areas of the reference frame.
        fields : PoseFields, optional
            The same pose under a displacement not far from this one: distances are carried over
            instead of being measured.

        Returns
        -------
        constraints : LinearConstraints
        fields : PoseFields
            What to hand over another time.
        """
        P, F = self.animation[index].points, self.transfer.F
        X, _ = self.transfer.apply(P, d, self.transfer.closest_points(P))
        anchors = replace(self.anchors, vertices=self.pose_vertices[index])
        measured = fields or PoseFields(anchors.fields(X, F, self.transfer.label))
        G = self.transfer.root_area * self.transfer.deformation.gradients(P)
        slid = measured if fields is None else fields.slide(X)
        found = [self._chips(rows, field, G) for rows, field in slid.fields]
        return self._linear(found, d), measured

    def _chips(self, rows: IntArray, field: GeodesicField, G: FloatArray) -> MeasuredChips:
        """Measure the chips about the anchors of a component.

        `G` (N, 3, 3) carries the moves that they are differentiated by to the pose.
        """
        K, width = self.parameters.bins, self.parameters.width
        unit = float(self.anchors.units[rows[0]])
        s, n, weights = field_chips(field, unit, K, width)
        own_G = G[field.component.vertices]
        directions = np.einsum("nxy,mnx->mny", own_G, distance_directions(field), optimize=True)
        J = chip_jacobian(field.rescaled(unit), directions, weights, width, K, len(G))
        return MeasuredChips(rows, s, n, J)

    def _linear(self, found: list[MeasuredChips], d: FloatArray) -> LinearConstraints:
        """State what the chips of all components, under the displacement d, still lack."""
        K = self.parameters.bins
        order = np.argsort(np.concatenate([each.rows for each in found]), kind="stable")
        s = np.concatenate([each.s for each in found])[order]
        n = np.concatenate([each.n for each in found])[order]
        rows = (order[:, None] * K + np.arange(K)).ravel()
        J = found[0].J if len(found) == 1 else csr_matrix(vstack([each.J for each in found]))
        J = csr_matrix(J[rows])
        usable = n >= MIN_VERTEX_COUNT
        J = csr_matrix(diags_array(self.words.ravel().astype(np.float64)) @ J)
        target = chip_targets(n, self.parameters.strength)
        shortfall = np.where(usable, target - self.words * s, 0.0).ravel()
        weight = np.where(usable, n / (n + HALF_WEIGHT_COUNT), 0.0).ravel()
        price = SHORTFALL_PRICE * self.parameters.width**2 * weight
        return LinearConstraints(J, shortfall + J @ d, target.ravel(), price)


def chip_targets(n: FloatArray, strength: float) -> FloatArray:
    """How far chips are to be driven, by the effective number of their vertices.

    In proportion to the noise that chance gives them, which detection softens them by: a chip of
    thousands of vertices is as clear at half of what one of a hundred needs.
    """
    noise = ATTACK_NOISE**2 + SINE_VARIANCE / np.maximum(n, 1.0)
    usual = ATTACK_NOISE**2 + SINE_VARIANCE / HALF_WEIGHT_COUNT
    return strength * np.minimum(np.sqrt(noise / usual), MAX_TARGET_RATIO)
