"""Small rigged stages, and what their rigs make of points, in closed form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt

from meshmark.arrays import FloatArray

RINGS, SIDES = 9, 8
ELBOW = np.array([1.0, 0.0, 0.0])
JOINTS = ["shoulder", "shoulder/elbow"]
# Degrees that the elbow is turned by, by time.
BENDS = {1.0: 0.0, 2.0: 30.0, 4.0: 90.0}


def tube() -> tuple[FloatArray, list[int], list[int]]:
    """Return points, counts and corners of an open tube of quads along x, from 0 to 2."""
    turn = 2 * np.pi * np.arange(SIDES) / SIDES
    ring = 0.2 * np.stack([np.zeros(SIDES), np.cos(turn), np.sin(turn)], axis=1)
    x = np.linspace(0, 2, RINGS)
    points = ring[None] + x[:, None, None] * np.eye(3)[0]
    near = np.arange((RINGS - 1) * SIDES).reshape(RINGS - 1, SIDES)
    quads = np.stack(
        [near, near + SIDES, np.roll(near, -1, 1) + SIDES, np.roll(near, -1, 1)], axis=-1
    )
    return points.reshape(-1, 3), [4] * quads[..., 0].size, quads.ravel().tolist()


def elbow_weights(points: FloatArray) -> FloatArray:
    """Return how much the elbow moves each point of the tube: a ramp about it."""
    return ((points[:, 0] - ELBOW[0]) / 0.5 + 0.5).clip(0, 1).astype(np.float32).astype(float)


def rotation(axis: Sequence[float], degrees: float) -> FloatArray:
    """Return the matrix (3, 3) that turns row vectors about a unit axis, by Rodrigues' formula."""
    x, y, z = axis
    K = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]], dtype=np.float64)
    angle = np.deg2rad(degrees)
    turned: FloatArray = np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
    return turned


def bent(degrees: float, offsets: FloatArray | float = 0.0) -> FloatArray:
    """Bend the tube at its elbow by linear skinning, about z; what is added moves along."""
    rest = tube()[0]
    w, points = elbow_weights(rest)[:, None], rest + offsets
    return (1 - w) * points + w * ((points - ELBOW) @ rotation((0, 0, 1), degrees) + ELBOW)


def twisted(degrees: float) -> FloatArray:
    """Twist the tube by dual quaternions: the axis stays, each ring turns by its share.

    Blended unit quaternions (cos a/2, sin a/2) of 0 and of `degrees`, normalised.
    """
    points, half = tube()[0], np.deg2rad(degrees) / 2
    w = elbow_weights(points)
    angles = 2 * np.arctan2(w * np.sin(half), (1 - w) + w * np.cos(half))
    return np.stack(
        [p @ rotation((1, 0, 0), np.rad2deg(a)) for p, a in zip(points, angles, strict=True)]
    )


@dataclass
class Rigged:
    """A stage with a SkelRoot `/man`, its skeleton `/man/bones` and animation `/man/walk`."""

    stage: Usd.Stage
    animation: UsdSkel.Animation

    @classmethod
    def at(cls, path: Path) -> Rigged:
        """Make one with two joints that stand still; nothing is bound."""
        path.parent.mkdir(parents=True, exist_ok=True)
        stage = Usd.Stage.CreateNew(str(path))
        root = UsdSkel.Root.Define(stage, "/man").GetPrim()
        stage.SetDefaultPrim(root)
        bones = UsdSkel.Skeleton.Define(stage, "/man/bones")
        bones.CreateJointsAttr(JOINTS)
        at_elbow = Gf.Matrix4d().SetTranslate(Gf.Vec3d(*ELBOW))
        bones.CreateBindTransformsAttr([Gf.Matrix4d(1), at_elbow])
        bones.CreateRestTransformsAttr([Gf.Matrix4d(1), at_elbow])
        animation = UsdSkel.Animation.Define(stage, "/man/walk")
        animation.CreateJointsAttr(JOINTS)
        animation.CreateTranslationsAttr([Gf.Vec3f(0), Gf.Vec3f(*ELBOW)])
        animation.CreateRotationsAttr([Gf.Quatf(1)] * 2)
        animation.CreateScalesAttr([Gf.Vec3h(1)] * 2)
        binding = UsdSkel.BindingAPI.Apply(bones.GetPrim())
        binding.CreateAnimationSourceRel().SetTargets([animation.GetPath()])
        return cls(stage, animation)

    def turn_elbow(self, degrees: Mapping[float, float], axis: Sequence[float] = (0, 0, 1)) -> None:
        """Sample the elbow's rotation."""
        attribute = self.animation.GetRotationsAttr()
        for time, angle in degrees.items():
            turn = Gf.Rotation(Gf.Vec3d(*axis), angle).GetQuat()
            attribute.Set(Vt.QuatfArray([Gf.Quatf(1), Gf.Quatf(turn)]), time)

    def add_tube(self, path: str = "/man/arm", *, inherited: bool = False) -> UsdGeom.Mesh:
        """Add a tube, bound to the skeleton by itself or through the SkelRoot."""
        return self.add(path, *tube(), inherited=inherited)

    def add(
        self,
        path: str,
        points: FloatArray,
        counts: Sequence[int],
        corners: Sequence[int],
        *,
        inherited: bool = False,
    ) -> UsdGeom.Mesh:
        """Add a mesh that bends at the elbow."""
        mesh = UsdGeom.Mesh.Define(self.stage, path)
        mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
        mesh.CreateFaceVertexCountsAttr(counts)
        mesh.CreateFaceVertexIndicesAttr(corners)
        mesh.CreateSubdivisionSchemeAttr("none")
        binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
        w = elbow_weights(points)
        binding.CreateJointIndicesPrimvar(False, 2).Set([0, 1] * len(points))
        binding.CreateJointWeightsPrimvar(False, 2).Set(np.stack([1 - w, w], axis=1).ravel())
        bound = self.stage.GetPrimAtPath("/man") if inherited else mesh.GetPrim()
        UsdSkel.BindingAPI.Apply(bound).CreateSkeletonRel().SetTargets(["/man/bones"])
        return mesh

    def add_shape(
        self,
        mesh: UsdGeom.Mesh,
        offsets: FloatArray,
        between: FloatArray,
        weights: Mapping[float, float],
    ) -> None:
        """Add a blend shape with an in-between at one half, and sample its weight."""
        shape = UsdSkel.BlendShape.Define(self.stage, mesh.GetPath().AppendChild("smile"))
        shape.CreateOffsetsAttr(Vt.Vec3fArray.FromNumpy(offsets.astype(np.float32)))
        half = shape.CreateInbetween("half")
        half.SetWeight(0.5)
        half.SetOffsets(Vt.Vec3fArray.FromNumpy(between.astype(np.float32)))
        binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
        binding.CreateBlendShapesAttr(["smile"])
        binding.CreateBlendShapeTargetsRel().SetTargets([shape.GetPath()])
        self.animation.CreateBlendShapesAttr(["smile"])
        attribute = self.animation.CreateBlendShapeWeightsAttr()
        for time, weight in weights.items():
            attribute.Set(Vt.FloatArray([weight]), time)

    def save(self) -> str:
        """Write the stage and return its path."""
        self.stage.GetRootLayer().Save()
        return str(self.stage.GetRootLayer().realPath)


def bent_tube(path: Path, *, inherited: bool = False) -> str:
    """Write a tube that bends by `BENDS`, and return its path."""
    rigged = Rigged.at(path)
    rigged.add_tube(inherited=inherited)
    rigged.turn_elbow(BENDS)
    return rigged.save()


def baked_by_usd(source: str) -> Usd.Stage:
    """Return the stage of a source with all skinning baked by usd-core, in memory."""
    stage = Usd.Stage.Open(source)
    layer = Sdf.Layer.CreateAnonymous()
    stage.GetSessionLayer().subLayerPaths.append(layer.identifier)
    stage.SetEditTarget(layer)
    for prim in list(stage.Traverse()):
        if prim.IsA(UsdSkel.Root):
            assert UsdSkel.BakeSkinning(UsdSkel.Root(prim))
    return stage
