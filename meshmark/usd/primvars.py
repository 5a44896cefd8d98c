"""What hangs on the points of a mesh prim: its primvars and normals, as numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from pxr import Usd, UsdGeom, Vt

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.charts import Charts, cut_along_seams, equal_rows
from meshmark.mesh.geometry import lengths
from meshmark.mesh.topology import triangulate
from meshmark.usd.geometry import connectivity_changes, polygons, time_code
from meshmark.usd.points import MeshPoints
from meshmark.usd.skinned_normals import BY_POINT, skinned_normals
from meshmark.usd.skinning import Rig

PAIRS = (Vt.Vec2hArray, Vt.Vec2fArray, Vt.Vec2dArray)
FLOATS = (
    *(Vt.HalfArray, Vt.FloatArray, Vt.DoubleArray, *PAIRS),
    *(Vt.Vec3hArray, Vt.Vec3fArray, Vt.Vec3dArray),
    *(Vt.Vec4hArray, Vt.Vec4fArray, Vt.Vec4dArray),
)
NORMALS = ("normals", "primvars:normals")
# Weights of joints are worth nothing without the joints that they are of: see `influences`.
SKINNING = "primvars:skel:"
# Unit vectors have this length, to the rounding of half precision.
UNIT = 2e-3
# As many of the times of an animation as tell what it is like.
LOOKED_AT = 12

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Layout:
    """How the values of an attribute lie on a mesh.

    Parameters
    ----------
    charts : Charts
        A row for each value that may be another.
    elements : (R,) int
        An element, which is a point or a corner, of each row.
    rows : (n,) int or None
        Row of each element; None where each has its own.
    """

    charts: Charts
    elements: IntArray
    rows: IntArray | None = None


@dataclass(frozen=True, eq=False)
class Hanging:
    """An attribute with a value for each point or each corner of a mesh.

    Parameters
    ----------
    attribute : Usd.Attribute
        The primvar, or `normals`.
    interpolation : str
        Of its values.
    layout : Layout
        Where these are.
    rig : Rig or None
        What turns them; None where they are as they are authored.
    """

    attribute: Usd.Attribute
    interpolation: str
    layout: Layout
    rig: Rig | None = None

    @property
    def name(self) -> str:
        """What the attribute is called."""
        return str(self.attribute.GetName())

    @cached_property
    def times(self) -> list[float]:
        """Times at which values, or their indices, are sampled; none where they are static."""
        return _times(self.attribute)

    @cached_property
    def is_normal(self) -> bool:
        """Whether it tells which way the surface faces."""
        return self.name in NORMALS and self.values(np.nan).shape[1] == 3

    @cached_property
    def is_unit(self) -> bool:
        """Whether it is a direction, of length 1."""
        values = self.values(np.nan)
        if self.attribute.GetTypeName().role not in ("Normal", "Vector") or values.shape[1] != 3:
            return False
        return bool(np.all(np.abs(lengths(values) - 1) <= UNIT))

    @cached_property
    def is_map(self) -> bool:
        """Whether it is a place on a picture, which goes on beyond the edge of a chart."""
        role = self.attribute.GetTypeName().role
        return role == "TextureCoordinate" or self._kind in PAIRS

    @property
    def is_indexed(self) -> bool:
        """Whether it has indices."""
        return self.can_have_indices and bool(UsdGeom.Primvar(self.attribute).IsIndexed())

    @property
    def can_have_indices(self) -> bool:
        """Whether it is a primvar; `normals` are not."""
        return bool(UsdGeom.Primvar(self.attribute))

    def elements(self, time: float) -> FloatArray:
        """Return the values of the elements as they are authored, (n, k) float64."""
        values = self._of_rows(_flat(self.attribute, time))
        return values if self.layout.rows is None else values[self.layout.rows]

    def values(self, time: float) -> FloatArray:
        """Return the values of the rows at a time, (R, k) float64."""
        if self.rig is None and not self.times:
            return self._static
        value = None if self.rig is None else skinned_normals(self.rig, time, self.attribute)
        return self._of_rows(_flat(self.attribute, time) if value is None else value)

    @cached_property
    def _kind(self) -> Any:
        return type(_flat(self.attribute, np.nan))

    @cached_property
    def _static(self) -> FloatArray:
        return self._of_rows(_flat(self.attribute, np.nan))

    def _of_rows(self, value: Any) -> FloatArray:
        n = len(self.layout.elements if self.layout.rows is None else self.layout.rows)
        return np.asarray(value, dtype=np.float64).reshape(n, -1)[self.layout.elements]

    def stored(self, values: FloatArray) -> Any:
        """Return values (R, k) as USD's own array of the attribute's type.

        One for each element if it cannot have indices, else one for each row.
        """
        if self.layout.rows is not None and not self.can_have_indices:
            values = values[self.layout.rows]
        like = np.asarray(self._kind(1))
        with np.errstate(over="ignore"):
            array = values.astype(like.dtype).reshape(-1, *like.shape[1:])
        return self._kind.FromNumpy(np.ascontiguousarray(array))


def hanging_on(points: MeshPoints, *, posed: bool) -> list[Hanging]:
    """List what hangs on the points or corners of a prim, and can be interpolated.

    These are arrays of floats and of vectors of floats, of interpolation `vertex`, `varying` or
    `faceVarying`, that fit the mesh and are finite at all their times. Weights of joints are
    left out; and where the connectivity changes over time, everything.

    Parameters
    ----------
    posed : bool
        Whether normals are wanted as a rig turns them.
    """
    if connectivity_changes(points.prim, points.times()):
        return []
    counts, vertices = polygons(UsdGeom.Mesh(points.prim), Usd.TimeCode.EarliestTime())
    n_points, first = len(points.local(points.times()[0])), points.times()[0]
    F = triangulate(counts, vertices)
    whole = Layout(Charts.whole(F, n_points), np.arange(n_points))
    found = []
    for attribute, interpolation in _offered(points.prim):
        by_point = interpolation in BY_POINT
        if not _fits(attribute, n_points if by_point else len(vertices)):
            continue
        layout = whole if by_point else _by_corner(F, counts, vertices, attribute)
        rig = points.rig if posed and attribute.GetName() in NORMALS else None
        if rig is not None and skinned_normals(rig, first, attribute) is None:
            rig = None
        found.append(Hanging(attribute, interpolation, layout, rig))
    return found


def spread(times: Sequence[T], most: int) -> list[T]:
    """Choose at most so many of several, evenly spaced, the first and the last among them."""
    places = np.linspace(0, len(times) - 1, min(len(times), most))
    return [times[place] for place in np.round(places).astype(int)]


def different(prim: Usd.Prim, other: Usd.Prim) -> set[str]:
    """Name the primvars of a prim, and its normals, that another does not have alike."""
    mine, theirs = (
        {each.GetName(): each for each in one.GetAuthoredAttributes()} for one in (prim, other)
    )
    names = {name for name in mine | theirs if name == "normals" or name.startswith("primvars:")}
    return {
        name.removesuffix(":indices")
        for name in names
        if not (name in mine and name in theirs and _equal(mine[name], theirs[name]))
    }


def _equal(one: Usd.Attribute, other: Usd.Attribute) -> bool:
    times = one.GetTimeSamples()
    return other.GetTimeSamples() == times and all(
        one.Get(code) == other.Get(code) for code in (Usd.TimeCode.Default(), *times)
    )


def _offered(prim: Usd.Prim) -> Iterator[tuple[Usd.Attribute, str]]:
    """Yield what has a value for each point or corner, and its interpolation."""
    mesh = UsdGeom.Mesh(prim)
    known = (*BY_POINT, UsdGeom.Tokens.faceVarying)
    if mesh.GetNormalsAttr().HasAuthoredValue() and mesh.GetNormalsInterpolation() in known:
        yield mesh.GetNormalsAttr(), mesh.GetNormalsInterpolation()
    for primvar in UsdGeom.PrimvarsAPI(prim).GetPrimvarsWithAuthoredValues():
        if primvar.GetInterpolation() in known and not primvar.GetName().startswith(SKINNING):
            yield primvar.GetAttr(), primvar.GetInterpolation()


def _fits(attribute: Usd.Attribute, n: int) -> bool:
    """Tell whether an attribute has finite floats for n elements at all times."""
    primvar = UsdGeom.Primvar(attribute)
    size = n * (primvar.GetElementSize() if primvar else 1)
    kinds = set()
    for time in _times(attribute) or [np.nan]:
        value = _flat(attribute, time)
        kinds.add(type(value))
        if not isinstance(value, FLOATS) or len(value) != size or len(kinds) > 1:
            return False
        if not np.all(np.isfinite(np.asarray(value))):
            return False
    return True


def _by_corner(
    F: IntArray, counts: IntArray, vertices: IntArray, attribute: Usd.Attribute
) -> Layout:
    """Lay values of corners out: neighbours that are equal have one row.

    Equal at the times that are looked at: a seam that opens at one time is there at most others.
    """
    same = np.zeros(len(vertices), dtype=np.int64)
    for time in spread(_times(attribute), LOOKED_AT) or [np.nan]:
        values = np.asarray(_flat(attribute, time)).reshape(len(vertices), -1)
        same = equal_rows(np.column_stack([same, equal_rows(values)]))
    corners = triangulate(counts, np.arange(len(vertices)))
    rows = cut_along_seams(F, corners, vertices, same)
    elements = np.unique(rows, return_index=True)[1]
    return Layout(Charts(rows[corners], vertices[elements]), elements, rows)


def _times(attribute: Usd.Attribute) -> list[float]:
    primvar = UsdGeom.Primvar(attribute)
    return list(primvar.GetTimeSamples() if primvar else attribute.GetTimeSamples())


def _flat(attribute: Usd.Attribute, time: float) -> Any:
    """Return the values at a time, indices looked up; None without any."""
    primvar = UsdGeom.Primvar(attribute)
    code = time_code(time)
    return primvar.ComputeFlattened(code) if primvar else attribute.Get(code)
