"""Blend shapes (UsdSkel): what they add to the points of a mesh, also where these slid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdSkel, Vt

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.charts import SlidPoints, equal_rows
from meshmark.usd.geometry import Float32Array
from meshmark.usd.layers import StreamedLayer

TARGETS = "skel:blendShapeTargets"
OFFSETS, NORMAL_OFFSETS = UsdSkel.Tokens.offsets, UsdSkel.Tokens.normalOffsets
INDICES = UsdSkel.Tokens.pointIndices
NOTHING = np.zeros((0, 3), dtype=np.float32)
# Offsets this near to each other, as a share of the largest, differ by the rounding of float32.
SAME = 1e-7


@dataclass(frozen=True, eq=False)
class Shape:
    """A blend shape and its in-betweens.

    Parameters
    ----------
    prim : Usd.Prim
        What holds it.
    vertices : (m,) int
        Which points it moves; empty for all.
    offsets : mapping of str to (m, 3) float32
        What its attributes add to points or to normals; (0, 3) for nothing.
    """

    prim: Usd.Prim
    vertices: IntArray
    offsets: Mapping[str, Float32Array]

    @classmethod
    def of(cls, shape: UsdSkel.BlendShape, vertices: Vt.IntArray) -> Shape:
        """Read one; what is no array of vectors adds nothing, and neither does what is missing."""
        if not shape:
            return cls(shape.GetPrim(), np.asarray(vertices, dtype=np.int64), {})
        attributes = [shape.GetOffsetsAttr(), shape.GetNormalOffsetsAttr()]
        for between in shape.GetInbetweens():
            attributes += [between.GetAttr(), between.GetNormalOffsetsAttr()]
        values = {each.GetName(): each.Get() for each in attributes if each}
        offsets = {
            str(name): np.asarray(value)
            for name, value in values.items()
            if isinstance(value, Vt.Vec3fArray) and value
        }
        return cls(shape.GetPrim(), np.asarray(vertices, dtype=np.int64), offsets)

    def fits(self, n_points: int) -> bool:
        """Tell whether it is a shape of so many points, and finite."""
        rows, size = self.vertices, len(self.vertices) or n_points
        within = rows.min(initial=0) >= 0 and rows.max(initial=0) < n_points
        return bool(within) and all(
            len(each) == size and np.all(np.isfinite(each)) for each in self.offsets.values()
        )

    def dense(self, name: str, n_points: int) -> FloatArray:
        """Return what an attribute adds to each point, (N, 3) float64."""
        found = np.zeros((n_points, 3))
        rows = self.vertices if self.vertices.size else np.arange(n_points)
        np.add.at(found, rows, self.offsets[name].astype(np.float64))
        return found

    def followed(self, slid: SlidPoints) -> Shape:
        """Give points that slid the offsets of their new places on the old surface.

        These are interpolated in the triangle there. A shape of some points only then moves those,
        too, that came to lie among them. Offsets of normals are turned as the surface was.
        """
        n = len(slid.rows)
        new: dict[str, FloatArray] = {}
        moved = np.zeros(n, dtype=bool)
        for name in self.offsets:
            old = self.dense(name, n)
            there = slid.values(old)
            if name.endswith(NORMAL_OFFSETS):
                there = slid.turned(there)
            same = SAME * np.abs(old).max(initial=0.0)
            changed = np.any(np.abs(there - old) > same, axis=1)
            new[name] = np.where(changed[:, None], there, old)
            moved |= np.any(np.abs(new[name]) > same, axis=1)
        rows = np.arange(n)
        vertices = self.vertices
        if vertices.size:
            listed = np.zeros(n, dtype=bool)
            listed[vertices] = True
            own = vertices if listed.sum() == vertices.size else np.flatnonzero(listed)
            rows = vertices = np.concatenate([own, np.flatnonzero(moved & ~listed)])
        return Shape(
            self.prim, vertices, {name: each[rows].astype(np.float32) for name, each in new.items()}
        )

    def author(self, target: StreamedLayer, path: Sdf.Path, before: Shape) -> None:
        """Write of it, at a path of the layer, what is other than before."""
        changed = [
            name
            for name, each in self.offsets.items()
            if not np.array_equal(each, before.offsets[name])
        ]
        if not changed:
            return
        over = Sdf.CreatePrimInLayer(target.layer, path)
        if not np.array_equal(self.vertices, before.vertices):
            target.set_integers(self._spec(over, INDICES), np.nan, self.vertices)
        for name in changed:
            target.set_vectors(self._spec(over, name), np.nan, self.offsets[name])

    def _spec(self, over: Sdf.PrimSpec, name: str) -> Sdf.AttributeSpec:
        attribute = self.prim.GetAttribute(name)
        # A mesh may be bound to the same shape twice.
        return over.attributes.get(name) or Sdf.AttributeSpec(
            over, name, attribute.GetTypeName(), attribute.GetVariability(), attribute.IsCustom()
        )


@dataclass(frozen=True, eq=False)
class BlendShapes:
    """The blend shapes of a mesh prim, and what animates them.

    To usd-core each is several sub-shapes: nothing, its in-betweens, and itself.

    Parameters
    ----------
    prim : Usd.Prim
        The mesh.
    query : UsdSkel.BlendShapeQuery
    mapper : UsdSkel.AnimMapper
    animation : UsdSkel.AnimQuery or None
    shapes : tuple of Shape
    """

    prim: Usd.Prim
    query: UsdSkel.BlendShapeQuery
    mapper: UsdSkel.AnimMapper
    animation: UsdSkel.AnimQuery | None
    shapes: tuple[Shape, ...]

    @classmethod
    def of(
        cls, skinning: UsdSkel.SkinningQuery, animation: UsdSkel.AnimQuery | None
    ) -> BlendShapes:
        """Collect those of a prim."""
        query = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(skinning.GetPrim()))
        vertices = query.ComputeBlendShapePointIndices()
        shapes = (Shape.of(query.GetBlendShape(i), each) for i, each in enumerate(vertices))
        mapper = skinning.GetBlendShapeMapper()
        return cls(skinning.GetPrim(), query, mapper, animation, tuple(shapes))

    def sub_shape_weights(self, code: Usd.TimeCode) -> tuple[Any, Any, Any] | None:
        """Return weight, blend shape and number of each sub-shape; None if unfit."""
        weights = self.animation.ComputeBlendShapeWeights(code) if self.animation else None
        mapped = None if weights is None else self.mapper.Remap(weights)
        if mapped is None or len(mapped) != self.query.GetNumBlendShapes():
            return None
        found: tuple[Any, Any, Any] = self.query.ComputeSubShapeWeights(mapped)
        return found

    def blended(self, points: Vt.Vec3fArray, code: Usd.TimeCode) -> Vt.Vec3fArray:
        """Add the shapes to the points of the rest pose, as far as they fit.

        Like usd-core's own baking, none of them where one of them does not.
        """
        weights = self.sub_shape_weights(code)
        blended = Vt.Vec3fArray(points)
        if weights is None or not self.query.ComputeDeformedPoints(
            *weights, *self._stored, blended
        ):
            return points
        return blended

    @cached_property
    def _stored(self) -> tuple[list[Vt.IntArray], list[Vt.Vec3fArray]]:
        vertices = [each.vertices.astype(np.int32) for each in self.shapes]
        return (
            [Vt.IntArray.FromNumpy(each) for each in vertices],
            [Vt.Vec3fArray.FromNumpy(each) for each in self._sub_shapes(OFFSETS)],
        )

    @cached_property
    def normal_offsets(self) -> list[Float32Array]:
        """What each sub-shape adds to normals, (m, 3) each; (0, 3) for nothing."""
        return self._sub_shapes(NORMAL_OFFSETS)

    def _sub_shapes(self, of_shape: str) -> list[Float32Array]:
        """List what sub-shapes add to points or normals; a shape has that in one attribute."""
        found = [NOTHING] * self.query.GetNumSubShapes()
        whole: dict[int, int] = {}
        for number in range(len(found)):
            shape, between = self.query.GetBlendShapeIndex(number), self.query.GetInbetween(number)
            if not between:
                # A shape is listed at weight 0, where it adds nothing, before weight 1.
                whole[shape] = number
                continue
            points = of_shape == OFFSETS
            attribute = between.GetAttr() if points else between.GetNormalOffsetsAttr()
            name = attribute.GetName() if attribute else ""
            found[number] = self.shapes[shape].offsets.get(name, NOTHING)
        for shape, number in whole.items():
            found[number] = self.shapes[shape].offsets.get(of_shape, NOTHING)
        return found

    def fits(self, n_points: int) -> bool:
        """Tell whether all are shapes of so many points: usd-core adds none if one is not."""
        return all(each.fits(n_points) for each in self.shapes)

    def alike(self, number: IntArray) -> IntArray:
        """Give points with equal numbers (N,) others, if they are not moved alike."""
        n = len(number)
        for shape in self.shapes:
            for name in shape.offsets:
                columns = np.column_stack([number, equal_rows(shape.dense(name, n))])
                number = equal_rows(columns)
        return number

    def followed(self, slid: SlidPoints, mesh: Sdf.Path, kept: frozenset[Sdf.Path]) -> BlendShapes:
        """Give points that slid the offsets of their new places.

        Shapes stay if they are to, or have no place in a layer that has the mesh at a path.
        """

        def after(shape: Shape) -> Shape:
            if not shape.offsets or shape.prim.GetPath() in kept or not self.place(shape, mesh):
                return shape
            return shape.followed(slid)

        return replace(self, shapes=tuple(map(after, self.shapes)))

    def author(self, target: StreamedLayer, mesh: Sdf.PrimSpec, before: BlendShapes) -> None:
        """Write what is other than before, beside what a layer says of the mesh."""
        for own, other in zip(self.shapes, before.shapes, strict=True):
            place = None if own is other else self.place(own, mesh.path)
            if place is not None:
                own.author(target, place, other)

    def place(self, shape: Shape, mesh: Sdf.Path) -> Sdf.Path | None:
        """Return where a layer that has the mesh at a path has a shape of it.

        What is inside an instance has its place in a class; what is around that has none.
        """
        path, prim = shape.prim.GetPath(), self.prim.GetPath()
        while prim.name == mesh.name and not prim.IsAbsoluteRootPath():
            prim, mesh = prim.GetParentPath(), mesh.GetParentPath()
        return path.ReplacePrefix(prim, mesh) if path.HasPrefix(prim) else None


def shapes_of(prim: Usd.Prim) -> set[Sdf.Path]:
    """List the blend shapes that a prim is bound to."""
    targets = prim.GetRelationship(TARGETS)
    return set(targets.GetForwardedTargets()) if targets else set()


def shared_shapes(stage: Usd.Stage) -> frozenset[Sdf.Path]:
    """List the blend shapes that several prims are bound to, or one that is not in their instance.

    What is written over such a shape would change other meshes, too, or nothing at all.
    """
    prims = Usd.PrimRange(
        stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)
    )
    users: dict[Sdf.Path, list[Usd.Prim]] = {}
    for prim in prims:
        for path in shapes_of(prim):
            users.setdefault(path, []).append(prim)
    return frozenset(
        path
        for path, bound in users.items()
        if len(bound) > 1
        or (
            (shape := stage.GetPrimAtPath(path)).IsValid()
            and shape.IsInstanceProxy() != bound[0].IsInstanceProxy()
        )
    )


def equal_shapes(prim: Usd.Prim, other: Usd.Prim) -> bool:
    """Tell whether two prims are bound to shapes of the same places, that hold the same."""
    mine = shapes_of(prim)
    return mine == shapes_of(other) and all(
        _held(prim.GetStage().GetPrimAtPath(path)) == _held(other.GetStage().GetPrimAtPath(path))
        for path in mine
    )


def _held(shape: Usd.Prim) -> dict[str, Any]:
    return {each.GetName(): each.Get() for each in shape.GetAuthoredAttributes()} if shape else {}
