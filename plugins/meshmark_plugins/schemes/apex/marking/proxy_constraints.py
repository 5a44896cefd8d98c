"""What each pose of a fine mesh asks of a displacement of its proxy."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.flip_guard import allowed_shares
from meshmark_plugins.schemes.apex.anchors.geodesic_field import GeodesicField
from meshmark_plugins.schemes.apex.anchors.proxies import Proxies
from meshmark_plugins.schemes.apex.chips.whitening import inverse_density_on_proxy
from meshmark_plugins.schemes.apex.marking.gradients import distance_directions
from meshmark_plugins.schemes.apex.marking.planning_proxy import PlanningProxy
from meshmark_plugins.schemes.apex.marking.pose_constraints import (
    MeasuredChips,
    PoseConstraints,
)
from meshmark_plugins.schemes.apex.marking.proxy_chips import surface_means, vertex_chips
from meshmark_plugins.schemes.apex.marking.solve_displacement import LinearConstraints


@dataclass(frozen=True, eq=False)
class PartField:
    """Distances on a part of the proxy in a pose as it is, nothing displaced.

    Parameters
    ----------
    part : int
        Which one.
    rows : (m,) int
        Which of the marked anchors it has.
    field : GeodesicField
        Of the proxy, in root areas.
    surface_means : (m, K) float64
        What the area in each bin takes off its chip. Vertices that slide do not change it.
    """

    part: int
    rows: IntArray
    field: GeodesicField
    surface_means: FloatArray


@dataclass(frozen=True, eq=False)
class ProxyConstraints(PoseConstraints):
    """Measures displacements of a proxy in poses; chips count every vertex of the mesh.

    Distances of a pose are measured once, nothing displaced: the proxy's vertices carry them along
    from there.

    Parameters
    ----------
    planning : PlanningProxy
        What is displaced.
    proxies : Proxies
        Of the mesh.
    """

    planning: PlanningProxy
    proxies: Proxies

    distances_last: ClassVar[bool] = True

    def constraints(
        self, index: int, d: FloatArray, fields: Any = None
    ) -> tuple[LinearConstraints, Any]:
        """Apply a displacement (3 n,) to frame `index`, and find what its chips still lack.

        Parameters are those of `PoseConstraints.constraints`.
        """
        points = self.animation[index].points
        P = self.transfer.positions(points)
        fields = fields or self._measure(index, points)
        G = self.transfer.root_area * self.transfer.deformation.gradients(P)
        moves = np.einsum("nij,nj->ni", G, d.reshape(-1, 3))
        shares = allowed_shares(P, P + moves, self.transfer.surface[1], np.inf)
        moves = shares[:, None] * moves
        return self._linear([self._of_part(each, moves, G) for each in fields], d), fields

    def _measure(self, index: int, points: FloatArray) -> list[PartField]:
        """Measure distances in a pose, part by part."""
        anchors = replace(self.anchors, vertices=self.pose_vertices[index])
        transfer = self.transfer
        fields = []
        for rows, field in anchors.fields(points, transfer.F, transfer.label, self.proxies):
            number = self.planning.number_of(field.component)
            V, F, H = field.surface
            means = surface_means(V, F, H, self._bin_width(rows), self.parameters.bins)
            fields.append(PartField(number, rows, self.planning.of_proxy(field), means))
        return fields

    def _of_part(self, measured: PartField, moves: FloatArray, G: FloatArray) -> MeasuredChips:
        """Measure the chips of a displaced part."""
        field, part = measured.field, self.planning.parts[measured.part]
        own = part.component.vertices
        directions = distance_directions(field)
        change = np.einsum("mnx,nx->mn", directions, moves[own]) / field.length_scale
        weights = inverse_density_on_proxy(
            field.V + moves[own],
            part.component.faces,
            field.length_scale,
            self.parameters.width / 2.0,
            part.prolongation,
        )
        means, n, J = vertex_chips(
            np.maximum(field.H + change, 0.0),
            np.einsum("nxy,mnx->mny", G[own], directions, optimize=True) / field.length_scale,
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
