"""Copies of unmarked points elsewhere in a layer, in whatever form: found, and moved along."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, UsdGeom

from meshmark.arrays import FloatArray, IntArray
from meshmark.delivery.clouds import find_cloud
from meshmark.delivery.copies import Match, Shape, find_in_order
from meshmark.usd.authoring import Witness
from meshmark.usd.geometry import REST, faces_vary, local_to_world, polygons, time_code
from meshmark.usd.layers import VECTOR_ARRAYS, extent, set_value, value_at, vector_array
from meshmark.usd.numbers import (
    Numbers,
    Place,
    clouds,
    readings,
    rewrite_numbers,
    views,
)
from meshmark.usd.points import StagePoints
from meshmark.usd.primvars import Hanging
from meshmark.usd.skinning import Rig

# Residuals below it are equally good.
EXACT = 1e-6


@dataclass(frozen=True, order=True)
class Moved:
    """A copy of a mesh's points that got the marked ones.

    Parameters
    ----------
    path : str
        The attribute; or the prim or property, and the key of its metadata.
    prim : str
        The mesh.
    """

    path: str
    prim: str


@dataclass(frozen=True, eq=False)
class Copy:
    """A copy of points in an array.

    Parameters
    ----------
    prim : str
        The mesh.
    numbers : (R, c) float64
        The array as it was read; writes go through.
    match : Match
        Which of its numbers are the image of which points.
    """

    prim: str
    numbers: FloatArray
    match: Match

    @property
    def values(self) -> FloatArray:
        """The numbers that are the image, (m, c) float64."""
        return self.numbers[np.ix_(self.match.rows, self.match.columns)]


@dataclass
class Traces:
    """The points of some meshes of a stage, and what is an image of them.

    Holds samples of the poses, not the points: these are read again from the stage; and by their
    paths, the rigs that pose marked rest poses.
    """

    points: StagePoints
    shapes: dict[str, list[Shape]] = field(default_factory=dict, init=False)
    rigs: dict[str, Rig] = field(default_factory=dict, init=False)

    def add(self, prim: str, time: float, points: NDArray[np.floating]) -> None:
        """Take note of the points of a mesh at a time.

        Raises
        ------
        InputError
            If its faces make no sense.
        """
        shape = self._shape(prim, time, len(points))
        if time != REST or not _shows(shape, points.astype(np.float64)):
            shape.add(time, points.astype(np.float64))

    def _shape(self, prim: str, time: float, n_points: int) -> Shape:
        """Return the last shape of a mesh; a new one, if it has other points or faces now."""
        mesh = self.points.of(self.points.stage.GetPrimAtPath(prim))
        last = self.shapes[prim][-1] if prim in self.shapes else None
        if last is not None and last.n_points == n_points and not faces_vary(mesh.prim):
            return last
        _, corners = polygons(UsdGeom.Mesh(mesh.prim), time_code(time))
        if last is not None and last.n_points == n_points and np.array_equal(last.corners, corners):
            return last

        def read(time: float) -> FloatArray:
            return mesh.local(time).astype(np.float64)

        self.shapes.setdefault(prim, []).append(Shape(n_points, corners, read))
        return self.shapes[prim][-1]

    def witness(self, prim: str) -> Witness:
        """Return what remembers each frame of a prim as it is authored."""
        return lambda time, original, _: self.add(prim, time, original)

    def marked(self, layer: Sdf.Layer, prim: str, time: float) -> FloatArray:
        """Return the points (N, 3) that a flattened layer gives a prim at a time.

        Where only its rest pose was marked, the rig poses that.
        """
        path = Sdf.Path(prim).AppendProperty("points")
        points = value_at(layer, path, time)
        rig = self.rigs.get(prim)
        if points is None and rig is not None:
            return rig.pose(np.asarray(value_at(layer, path, REST)), time)
        return np.asarray(points, dtype=np.float64)

    def has_copy(self, hanging: Hanging) -> bool:
        """Tell whether what hangs on a mesh is an image of points, as a reference pose is."""
        owner = str(hanging.attribute.GetPrim().GetPath())
        times = hanging.times or [np.nan]
        for time in dict.fromkeys((times[0], times[len(times) // 2], times[-1])):
            place = Place(f"{owner}.{hanging.name}", owner, time)
            if self.find(hanging.elements(time), place):
                return True
        return False

    def find(self, numbers: FloatArray, place: Place, without: Iterable[str] = ()) -> list[Copy]:
        """Find copies of points in numbers (M, d) that writes go through to; none overlap.

        The prim the numbers belong to is the first choice where several meshes are alike; those
        in `without` are none.
        """
        known = [
            (prim, shape)
            for prim, shapes in self.shapes.items()
            if prim not in without
            for shape in shapes
        ]
        known.sort(key=lambda each: each[0] != place.owner)
        found = _in_order(numbers, known, place)
        if not found and place.thorough:
            found = self._in_clouds(numbers, known, place)
        return found

    def _in_clouds(
        self, numbers: FloatArray, known: Iterable[tuple[str, Shape]], place: Place
    ) -> list[Copy]:
        for cloud in clouds(numbers):
            found: list[Copy] = []
            left = np.arange(len(cloud))
            for prim, shape in known:
                to_world = partial(local_to_world, self.points.stage.GetPrimAtPath(prim))
                match = find_cloud(cloud[left], shape, hint=place.time, to_world=to_world)
                if match is not None:
                    found.append(Copy(prim, cloud, replace(match, rows=left[match.rows])))
                    left = np.delete(left, match.rows)
            if found:
                return found
        return []


def _shows(shape: Shape, rest: FloatArray) -> bool:
    """Tell whether a frame shows a rest pose (N, 3): copies of it are then that frame's."""
    matches = find_in_order(rest, shape, np.arange(len(rest)), shape.sampled)
    return any(match.residual <= EXACT for match in matches)


def _in_order(numbers: FloatArray, known: Iterable[tuple[str, Shape]], place: Place) -> list[Copy]:
    cells = np.arange(numbers.size).reshape(numbers.shape)
    every: list[tuple[Copy, IntArray]] = []
    for prim, shape in known:
        for vertices, samples in shape.layouts():
            seen = views(numbers, vertices, samples, place.indices)
            seen_cells = views(cells, vertices, samples, place.indices)
            for (view, rows, of_samples), (view_cells, _, _) in zip(seen, seen_cells, strict=True):
                for match in find_in_order(view, shape, rows, of_samples, place.time):
                    held = view_cells[np.ix_(match.rows, match.columns)]
                    every.append((Copy(prim, view, match), held))
    # Of equally good ones the first, which is the owner's.
    every.sort(key=lambda each: max(each[0].match.residual, EXACT))
    taken = np.zeros(numbers.size, dtype=bool)
    found = []
    for copy, held in every:
        if not taken[held].any():
            taken[held] = True
            found.append(copy)
    return found


def replace_traces(layer: Sdf.Layer, traces: Traces) -> list[Moved]:
    """Put marked points wherever a flattened layer holds an image of the same points unmarked.

    A default beside the time samples of a marked prim's points is removed.

    Returns
    -------
    list of Moved
        What was replaced, sorted.
    """

    def moved(array: Numbers, place: Place) -> tuple[Numbers, set[str]]:
        if place.path in own:
            return array, set()
        for table, back in readings(array):
            new = table.astype(np.float64)
            found = traces.find(new, place)
            for copy in found:
                points = traces.marked(layer, copy.prim, copy.match.time)
                rows, columns = copy.match.rows, copy.match.columns
                copy.numbers[np.ix_(rows, columns)] = copy.match.image(points)
            if found:
                return back(new), {copy.prim for copy in found}
        return array, set()

    own = {f"{prim}.points" for prim in traces.shapes}
    found = sorted(Moved(path, prim) for path, prim in rewrite_numbers(layer, moved))
    for path in own:
        if layer.GetNumTimeSamplesForPath(path):
            layer.GetAttributeAtPath(path).ClearDefaultValue()
    for path in dict.fromkeys(each.path for each in found):
        _fit_extent(layer, path)
    return found


def _fit_extent(layer: Sdf.Layer, path: str) -> None:
    if not path.endswith(".points") or " " in path:
        return
    box = Sdf.Path(path).GetPrimPath().AppendProperty("extent")
    for time in (np.nan, *layer.ListTimeSamplesForPath(path)):
        points = value_at(layer, Sdf.Path(path), time)
        if not isinstance(points, tuple(VECTOR_ARRAYS.values())) or not points:
            continue
        if value_at(layer, box, time) is not None:
            set_value(layer, box, time, vector_array(extent(np.asarray(points))))
