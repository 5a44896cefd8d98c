"""What each pose asks of a displacement: linear constraints on its chips."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix, vstack

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.flip_guard import allowed_shares
from meshmark_plugins.schemes.apex.anchors.geodesic_field import GeodesicField
from meshmark_plugins.schemes.apex.anchors.pose_distances import PoseDistances
from meshmark_plugins.schemes.apex.anchors.proxies import Proxies
from meshmark_plugins.schemes.apex.chips.gradients import (
    carried_changes,
    distance_directions,
    surface_means,
    vertex_chips,
)
from meshmark_plugins.schemes.apex.chips.soft_chips import (
    ATTACK_NOISE,
    MIN_VERTEX_COUNT,
    SINE_VARIANCE,
)
from meshmark_plugins.schemes.apex.chips.whitening import (
    inverse_density_on_proxy,
    spread_masses_by_rows,
)
from meshmark_plugins.schemes.apex.marking.displacement_transfer import DisplacementTransfer
from meshmark_plugins.schemes.apex.marking.marked_anchors import MarkedAnchors
from meshmark_plugins.schemes.apex.marking.planning_proxy import PlanningProxy
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
class PartField:
    """Distances on a part of what is displaced, in a pose as it is.

    Parameters
    ----------
    part : int
        Which one.
    rows : (m,) int
        Which of the marked anchors it has.
    field : GeodesicField
        In root areas.
    surface_means : (m, K) float64
        What the area in each bin takes off its chip. Vertices that slide do not change it.
    weights : (N,) float64, optional
        Whitening weights of the mesh's vertices, under some displacement near the one asked about.
    """

    part: int
    rows: IntArray
    field: GeodesicField
    surface_means: FloatArray
    weights: FloatArray | None = None


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


# A frame, the displacement that is asked about, and what is known of the pose.
PoseTask = tuple[int, FloatArray, Any]


@dataclass(frozen=True, eq=False)
class PoseConstraints:
    """Measures displacements in poses of an animation; picklable, for worker processes.

    Parameters
    ----------
    animation : MeshAnimation
        Frames as analysis sees them, of one topology.
    transfer : DisplacementTransfer
        Transfers displacements to them.
    displaced : MeshAnimation
        What is displaced, in the same frames.
    anchors : MarkedAnchors
        The anchors and their units.
    words : (C, K) int
        Word of each anchor.
    parameters : Parameters
        Bins and strength.
    pose_vertices : mapping of (C,) int
        Where the anchors are detected in each pose, by frame.
    poses : mapping of int
        The frame in which each pose was looked at for anchors, by frame.
    distances : PoseDistances
        From those that were detected.
    planning : PlanningProxy
        What is displaced; chips count every vertex of the mesh.
    proxies : Proxies
        Of the mesh.

    Notes
    -----
    Distances of a pose are measured once, nothing displaced: vertices carry them along from there,
    to first order. They slide by a tenth of a bin or so, over which the way from an anchor hardly
    turns.
    """

    animation: MeshAnimation
    transfer: DisplacementTransfer
    displaced: MeshAnimation
    anchors: MarkedAnchors
    words: IntArray
    parameters: Parameters
    pose_vertices: Mapping[int, IntArray]
    poses: Mapping[int, int]
    distances: PoseDistances
    planning: PlanningProxy
    proxies: Proxies

    def __call__(self, task: PoseTask) -> tuple[LinearConstraints, list[PartField]]:
        """Apply a displacement (3 n,) to a frame, and find what its chips still lack.

        Returns
        -------
        constraints : LinearConstraints
        fields : list of PartField
            What to hand over when another displacement of the same frame is asked about.
        """
        index, d, fields = task
        P = self.displaced[index].points
        fields = fields or self._measure(index)
        G = self.transfer.root_area * self.transfer.deformation.gradients(P)
        moves = np.einsum("nij,nj->ni", G, d.reshape(-1, 3))
        shares = allowed_shares(P, P + moves, self.transfer.surface[1], np.inf)
        moves = shares[:, None] * moves
        weights = [
            self._weights(each, moves) if each.weights is None else each.weights for each in fields
        ]
        found = [
            self._of_part(each, own, moves, G) for each, own in zip(fields, weights, strict=True)
        ]
        # No other displacement is near to none at all.
        if d.any():
            fields = [replace(f, weights=own) for f, own in zip(fields, weights, strict=True)]
        return self._linear(found, d), fields

    def _measure(self, index: int) -> list[PartField]:
        """Measure distances in a pose, part by part, unless they are known from detection."""
        fields = []
        for rows, number, field in self._kept(index) or self._measured(index):
            V, F, H = field.surface
            means = surface_means(V, F, H, self._bin_width(rows), self.parameters.bins)
            fields.append(PartField(number, rows, field, means))
        return fields

    def _kept(self, index: int) -> list[tuple[IntArray, int, GeodesicField]]:
        """Find distances that detection measured; none if any anchor was not detected."""
        P, vertices = self.displaced[index].points, self.pose_vertices[index]
        found, n_found = [], 0
        for kept in self.distances.of(self.poses[index]):
            rows = np.flatnonzero(np.isin(vertices, kept.anchors))
            if not rows.size:
                continue
            number = self.planning.number_of(kept.first)
            component, H = self.planning.parts[number].component, kept.from_some(vertices[rows])
            V, unknown = P[component.vertices], np.zeros(len(rows))
            field = GeodesicField(component, V, *kept.root_areas, vertices[rows], unknown, H)
            found.append((rows, number, field))
            n_found += len(rows)
        return found if n_found == len(vertices) else []

    def _measured(self, index: int) -> list[tuple[IntArray, int, GeodesicField]]:
        anchors = replace(self.anchors, vertices=self.pose_vertices[index])
        points, transfer = self.animation[index].points, self.transfer
        return [
            (
                rows,
                self.planning.number_of(int(field.component.vertices[0])),
                self.planning.of_proxy(field),
            )
            for rows, field in anchors.fields(points, transfer.F, transfer.label, self.proxies)
        ]

    def _weights(self, measured: PartField, moves: FloatArray) -> FloatArray:
        """Find the whitening weights of the mesh's vertices on a displaced part, (N,)."""
        field, part = measured.field, self.planning.parts[measured.part]
        return inverse_density_on_proxy(
            field.V + moves[part.component.vertices],
            part.component.faces,
            field.length_scale,
            self.parameters.width / 2.0,
            part.prolongation,
            spread_masses_by_rows,
        )

    def _of_part(
        self, measured: PartField, weights: FloatArray, moves: FloatArray, G: FloatArray
    ) -> MeasuredChips:
        """Measure the chips of a displaced part."""
        field, part = measured.field, self.planning.parts[measured.part]
        own = part.component.vertices
        slopes, change = carried_changes(
            distance_directions(field), G[own], moves[own], field.length_scale
        )
        means, n, J = vertex_chips(
            np.maximum(field.H + change, 0.0),
            slopes,
            part.prolongation,
            weights,
            self._bin_width(measured.rows),
            self.parameters.bins,
        )
        return MeasuredChips(
            measured.rows, means - measured.surface_means, n, part.spread(J, len(G))
        )

    def _bin_width(self, rows: IntArray) -> float:
        """Width of a bin about some anchors of one component, in root areas."""
        return self.parameters.width * float(self.anchors.units[rows[0]])

    def _linear(self, found: list[MeasuredChips], d: FloatArray) -> LinearConstraints:
        """State what the chips of all components, under the displacement d, still lack."""
        K = self.parameters.bins
        order = np.argsort(np.concatenate([each.rows for each in found]), kind="stable")
        s = np.concatenate([each.s for each in found])[order]
        n = np.concatenate([each.n for each in found])[order]
        # Rows of one component are in the anchors' order already.
        J = found[0].J
        if len(found) > 1:
            rows = (order[:, None] * K + np.arange(K)).ravel()
            J = csr_matrix(csr_matrix(vstack([each.J for each in found]))[rows])
        # In place, which leaves the entries where they are.
        J.data *= np.repeat(self.words.ravel(), np.diff(J.indptr))
        usable = n >= MIN_VERTEX_COUNT
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
