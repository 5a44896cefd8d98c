"""One displacement of the surface, as it lies in different poses, and what each pose asks of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from scipy.sparse import csr_matrix, diags_array, vstack

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.closest_points import ClosestPoints
from meshmark.mesh.deformation import Deformation
from meshmark.mesh.flip_guard import allowed_shares
from meshmark.mesh.geometry import face_areas
from meshmark.mesh.topology import face_components
from meshmark_plugins.schemes.apex.anchors.geodesic_field import GeodesicField
from meshmark_plugins.schemes.apex.chips.radial_histogram import radial_histograms
from meshmark_plugins.schemes.apex.chips.scale_hypotheses import cells_needed
from meshmark_plugins.schemes.apex.chips.soft_chips import (
    ATTACK_NOISE,
    MIN_VERTEX_COUNT,
    SINE_VARIANCE,
    measure_chips,
)
from meshmark_plugins.schemes.apex.chips.whitening import whitening_weights
from meshmark_plugins.schemes.apex.marking.anchor_words import Layout
from meshmark_plugins.schemes.apex.marking.gradients import (
    chip_gradients,
    distance_directions,
    slid,
)
from meshmark_plugins.schemes.apex.marking.solve_displacement import Demand
from meshmark_plugins.schemes.apex.parameters import Parameters

Question = Literal["demand", "share"]

# Price of a chip's shortfall beside moving a vertex by a bin's width; above some 1, chips that
# contradict each other distort the mesh for nothing.
PRICE = 0.5
# Vertices of a bin from which on its chip is worth half of what it can be.
HALF_WORTH = 100.0
# A chip of very few vertices is driven no farther than this, in strengths.
MOST = 1.25


@dataclass(frozen=True, eq=False)
class Cover:
    """A displacement of a reference frame, in its root areas, carried to other frames.

    Parameters
    ----------
    V : (N, 3) float64
        Positions of the reference frame.
    F : (F, 3) int
        Triangles of all frames.
    """

    V: FloatArray
    F: IntArray

    @cached_property
    def root_area(self) -> float:
        """Square root of the reference frame's area."""
        return float(np.sqrt(face_areas(self.V, self.F).sum()))

    @cached_property
    def label(self) -> IntArray:
        """Edge-connected component of each triangle, (F,) int."""
        return face_components(self.F)

    @cached_property
    def deformation(self) -> Deformation:
        """How the surface turns and stretches from the reference to other frames."""
        return Deformation(self.V, self.F)

    def laid(
        self, P: FloatArray, d: FloatArray, original: ClosestPoints
    ) -> tuple[FloatArray, FloatArray]:
        """Lay a displacement (3 N,) over another frame's surface.

        Returns
        -------
        X : (N, 3) float64
            Positions on the surface P, no face turned over.
        share : (N,) float64
            How much of its move that left each vertex.
        """
        moves = self.root_area * self.deformation.carry(d.reshape(-1, 3), P)
        wanted = original.points(P + moves)
        share = allowed_shares(P, wanted, self.F, np.inf)
        return P + share[:, None] * (wanted - P), share


@dataclass(frozen=True, eq=False)
class Measured:
    """Distances from the anchors in a pose.

    Parameters
    ----------
    fields : list of ((m,) int, Neighbourhood)
        Piece by piece, with which of the layout's anchors each has.
    """

    fields: list[tuple[IntArray, GeodesicField]]

    def slid(self, X: FloatArray) -> Measured:
        """Carry the distances along with vertices that have slid a little, to X (N, 3)."""
        return Measured(
            [(rows, slid(field, X[field.component.vertices])) for rows, field in self.fields]
        )


# A question, the frame and the displacement it is about, and what is known of the pose.
Work = tuple[Question, int, FloatArray, Measured | None]


@dataclass(frozen=True, eq=False)
class AskPose:
    """Measures displacements in poses of an animation; picklable, for worker processes.

    Parameters
    ----------
    animation : MeshAnimation
        Frames as analysis sees them, of one topology.
    cover : Cover
        Carries displacements to them.
    layout : Layout
        The anchors and their units.
    words : (C, K) int
        Word of each anchor.
    parameters : Tuning
        Bins and strength.
    anchors : mapping of (C,) int
        Where the anchors are seen in each pose, by frame.
    """

    animation: MeshAnimation
    cover: Cover
    layout: Layout
    words: IntArray
    parameters: Parameters
    anchors: Mapping[int, IntArray]

    def __call__(self, work: Work) -> Any:
        """Answer a question about a frame and a displacement; see the methods of that name."""
        question, index, d, before = work
        return self.share(index, d) if question == "share" else self.demand(index, d, before)

    def share(self, index: int, d: FloatArray) -> FloatArray:
        """Find how much of its move frame `index` leaves each vertex, (N,)."""
        P = self.animation[index].points
        return self.cover.laid(P, d, ClosestPoints(P, self.cover.F))[1]

    def demand(
        self, index: int, d: FloatArray, before: Measured | None = None
    ) -> tuple[Demand, Measured]:
        """Lay a displacement over frame `index`, and see what its chips still want.

        Parameters
        ----------
        index : int
            The frame.
        d : (3 N,) float64
            The displacement, in root areas of the reference frame.
        before : Measured, optional
            The same pose under a displacement not far from this one: distances are carried over
            instead of being measured.

        Returns
        -------
        demand : Demand
        measured : Measured
            What to hand over another time.
        """
        P, F = self.animation[index].points, self.cover.F
        X, _ = self.cover.laid(P, d, ClosestPoints(P, F))
        layout = replace(self.layout, anchors=self.anchors[index])
        measured = before or Measured(layout.measured(X, F, self.cover.label))
        G = self.cover.root_area * self.cover.deformation.gradients(P)
        s, n, J = self._chips(measured if before is None else before.slid(X), G)
        right = self.words * s
        held = n >= MIN_VERTEX_COUNT
        J = csr_matrix(diags_array(self.words.ravel().astype(np.float64)) @ J)
        target = targets(n, self.parameters.strength)
        lacking = np.where(held, target - right, 0.0).ravel()
        worth = np.where(held, n / (n + HALF_WORTH), 0.0).ravel()
        change = lacking + J @ d
        return Demand(J, change, target.ravel(), PRICE * self.parameters.width**2 * worth), measured

    def _chips(
        self, measured: Measured, G: FloatArray
    ) -> tuple[FloatArray, FloatArray, csr_matrix]:
        """Measure chips (C, K), their counts, and their gradients (C K, 3 N).

        `G` (N, 3, 3) carries the moves that they are differentiated by to the pose.
        """
        K, width = self.parameters.bins, self.parameters.width
        found = []
        for rows, field in measured.fields:
            unit = float(self.layout.units[rows[0]])
            s, n, weights = chips_about(field, unit, K, width)
            directions = np.einsum(
                "nxy,mnx->mny",
                G[field.component.vertices],
                distance_directions(field),
                optimize=True,
            )
            J = chip_gradients(field.rescaled(unit), directions, weights, width, K, len(G))
            found.append((s, n, J))
        order = np.argsort(np.concatenate([rows for rows, _ in measured.fields]), kind="stable")
        s, n = (np.concatenate([item[k] for item in found])[order] for k in (0, 1))
        rows = (order[:, None] * K + np.arange(K)).ravel()
        J = found[0][2] if len(found) == 1 else csr_matrix(vstack([item[2] for item in found]))
        return s, n, csr_matrix(J[rows])


def targets(n: FloatArray, strength: float) -> FloatArray:
    """How far chips are to be driven, by the number of vertices they are worth.

    In proportion to what chance does to them, which detection softens them by: a chip of
    thousands of vertices is as clear at half of what one of a hundred needs.
    """
    noise = ATTACK_NOISE**2 + SINE_VARIANCE / np.maximum(n, 1.0)
    usual = ATTACK_NOISE**2 + SINE_VARIANCE / HALF_WORTH
    return strength * np.minimum(np.sqrt(noise / usual), MOST)


def chips_about(
    field: GeodesicField, unit: float, n_bins: int, width: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Measure the chips about the anchors of a piece as they are marked.

    Parameters
    ----------
    field : Neighbourhood
        In root areas.
    unit : float
        The unit of its marks, in root areas.

    Returns
    -------
    s, n : (C, K) float64
        Chips, and how many vertices each is worth.
    weights : (n,) float64
        Weights of the piece's vertices.
    """
    weights = whitening_weights(field, width)
    histograms = radial_histograms(
        field.rescaled(unit), weights, width, cells_needed(n_bins, width)
    )
    s, n = measure_chips(histograms, n_bins, np.ones(1), np.zeros(1))
    return s[0], n[0], weights


def held_chips(V: FloatArray, F: IntArray, layout: Layout, parameters: Parameters) -> int:
    """Count the chips of a mesh that have enough vertices to say something."""
    held = 0
    for rows, field in layout.measured(V, F):
        _, n, _ = chips_about(
            field, float(layout.units[rows[0]]), parameters.bins, parameters.width
        )
        held += int(np.count_nonzero(n >= MIN_VERTEX_COUNT))
    return held
