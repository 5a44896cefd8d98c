"""A look at one frame: its pieces, their anchors, and the distances from them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import CapacityError
from meshmark.mesh.geometry import vertex_areas
from meshmark_plugins.schemes.apex.anchors.components import Piece, reference_lengths, split
from meshmark_plugins.schemes.apex.anchors.geodesics import RadialDistances
from meshmark_plugins.schemes.apex.anchors.integral_distance import find_anchors
from meshmark_plugins.schemes.apex.anchors.persistence import Maxima

# What counts as the neighbourhood of an anchor, in root areas.
VICINITY = 0.3


@dataclass(frozen=True, eq=False)
class Neighbourhood:
    """The anchors of one piece of a frame, and how far everything is from them.

    Parameters
    ----------
    piece : Piece
        Which vertices and triangles.
    V : (n, 3) float64
        Positions of the piece's vertices.
    unit : float
        Length in which distances are given; see `reference_lengths`.
    whole : float
        That of the largest piece of the mesh.
    anchors : (m,) int
        Vertices of the mesh (not of the piece).
    persistence : (m,) float64
        How far each stands out, in root areas; 0 where it was given, not found.
    H : (m, n) float64
        Distance of the piece's vertices from each anchor, in units.
    """

    piece: Piece
    V: FloatArray
    unit: float
    whole: float
    anchors: IntArray
    persistence: FloatArray
    H: FloatArray

    @property
    def bulk(self) -> FloatArray:
        """Share of the piece's area within `VICINITY` of each anchor, (m,).

        It tells a nose from a hoof from a tail, and hardly changes as the body moves.
        """
        return self._shares((self.H < VICINITY).astype(np.float64))

    def in_units(self, factor: float) -> Neighbourhood:
        """Give the same distances in units that are so many times as long."""
        return replace(self, unit=self.unit * factor, H=self.H / factor)

    @property
    def remoteness(self) -> FloatArray:
        """Mean distance of the piece's surface from each anchor, (m,), in root areas."""
        return self._shares(self.H)

    def _shares(self, values: FloatArray) -> FloatArray:
        areas = vertex_areas(self.V, self.piece.faces)
        return values @ areas / areas.sum()


@dataclass(frozen=True, eq=False)
class Look:
    """The anchors of one piece of a frame, before distances from them are measured.

    Parameters
    ----------
    piece : Piece
        Which vertices and triangles.
    V : (n, 3) float64
        Positions of the piece's vertices.
    lengths : (float, float)
        Reference lengths of the piece, and of the largest one.
    radial : RadialDistances
        Its distances.
    maxima : Maxima
        The anchors, vertices of the piece.
    """

    piece: Piece
    V: FloatArray
    lengths: tuple[float, float]
    radial: RadialDistances
    maxima: Maxima

    def measured(self) -> Neighbourhood:
        """Measure from the anchors."""
        vertices, persistence = self.maxima.vertices, self.maxima.persistence
        return _measured(self.piece, self.lengths, self.V, self.radial, vertices, persistence)


def look(V: FloatArray, F: IntArray, least: float, most: int) -> list[Look]:
    """Find the anchors of a mesh, piece by piece.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    F : (F, 3) int
        Triangles.
    least : float
        Least persistence of an anchor, in root areas of its piece.
    most : int
        Most anchors, over all pieces.

    Raises
    ------
    CapacityError
        If there is no anchor.
    """
    pieces = split(V, F)
    units = reference_lengths(V, pieces)
    found: list[Look] = []
    for piece, unit in zip(pieces, units, strict=True):
        points = V[piece.vertices]
        radial = RadialDistances(points, piece.faces)
        maxima = find_anchors(points, piece.faces, radial, least, most)
        if maxima.vertices.size:
            found.append(Look(piece, points, (unit, units[0]), radial, maxima))
    if not found:
        raise CapacityError(
            "no part of the mesh sticks out far enough to measure from: "
            "a mark needs tips such as hands, feet, ears or a tail"
        )
    persistence = np.concatenate([piece.maxima.persistence for piece in found])
    chosen = np.zeros(len(persistence), dtype=bool)
    chosen[np.argsort(-persistence, kind="stable")[:most]] = True
    ends = np.cumsum([len(piece.maxima.vertices) for piece in found])[:-1]
    return [
        replace(piece, maxima=piece.maxima.only(kept))
        for piece, kept in zip(found, np.split(chosen, ends), strict=True)
        if kept.any()
    ]


def survey(V: FloatArray, F: IntArray, least: float, most: int) -> list[Neighbourhood]:
    """Find the anchors of a mesh, and measure from them; parameters and errors as of `look`."""
    return [piece.measured() for piece in look(V, F, least, most)]


def measure_from(
    V: FloatArray, F: IntArray, anchors: IntArray, label: IntArray | None = None
) -> list[Neighbourhood]:
    """Measure from anchors that are known already, piece by piece.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    F : (F, 3) int
        Triangles.
    anchors : (m,) int
        Vertices.
    label : (F,) int, optional
        The edge-connected components of the triangles, where they are known.

    Raises
    ------
    CapacityError
        If one of them lies in no piece.
    """
    found, left = [], len(anchors)
    pieces = split(V, F, label)
    units = reference_lengths(V, pieces)
    for piece, unit in zip(pieces, units, strict=True):
        place = np.full(len(V), -1)
        place[piece.vertices] = np.arange(len(piece.vertices))
        own = place[anchors][place[anchors] >= 0]
        if own.size:
            points = V[piece.vertices]
            radial = RadialDistances(points, piece.faces)
            lengths = (unit, units[0])
            found.append(_measured(piece, lengths, points, radial, own, np.zeros(len(own))))
            left -= len(own)
    if left:
        raise CapacityError("an anchor lies in a piece that is too small in some frame")
    return found


def _measured(
    piece: Piece,
    lengths: tuple[float, float],
    points: FloatArray,
    radial: RadialDistances,
    anchors: IntArray,
    persistence: FloatArray,
) -> Neighbourhood:
    return Neighbourhood(
        piece=piece,
        V=points,
        unit=lengths[0],
        whole=lengths[1],
        anchors=piece.vertices[anchors],
        persistence=persistence,
        H=radial.from_vertices(anchors) * (radial.root_area / lengths[0]),
    )
