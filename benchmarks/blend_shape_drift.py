"""Writes the table of docs/formats.md on blend shapes: how far a slide leaves the posed surface.

usage: python benchmarks/blend_shape_drift.py

The demonstration's creature gets blend shapes, is marked by apex alone, which slides points along
the surface, and written as a rest pose with `--primvars keep` and `follow`. Its points then are
as far from the posed unmarked surface as the slide has left that.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom, UsdSkel, Vt

from meshmark import Key
from meshmark.arrays import FloatArray
from meshmark.demo import creature
from meshmark.embedding.asset import embed
from meshmark.extension.recipe import recipe_from_text
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.closest_points import ClosestPoints
from meshmark.usd.reading import read_stage
from meshmark.usd.writing import write_override

KEY = Key(bytes(range(32)))
FRAMES = 12
# Weights of new poses, as a share of those of the source.
EXAGGERATED = 1.5


def shapes(V: FloatArray) -> Mapping[str, FloatArray]:
    """Return offsets (N, 3): all of it arched, its front turned aside, dents all over."""
    size = np.ptp(V, axis=0).max()
    x, y, z = ((V - V.mean(axis=0)) / size).T
    nothing = np.zeros_like(x)
    front = np.clip((x - 0.15) / 0.1, 0, 1)
    dents = 0.03 * np.sin(40 * x) * np.sin(40 * y) * np.sin(40 * z)
    found = {
        "arched": (nothing, -0.8 * x**2, nothing),
        "aside": (nothing, nothing, 0.3 * front * (3 * front - 2 * front**2)),
        "dented": (dents, dents, dents),
    }
    return {name: size * np.stack(each, axis=1) for name, each in found.items()}


def write_shaped(frame: Frame, path: Path, scale: float = 1.0) -> str:
    """Write a frame as a stage whose blend shapes come and go, one after the other."""
    stage = Usd.Stage.CreateNew(str(path))
    stage.SetDefaultPrim(UsdSkel.Root.Define(stage, "/body").GetPrim())
    mesh = UsdGeom.Mesh.Define(stage, "/body/skin")
    mesh.CreatePointsAttr(vectors(frame.points))
    mesh.CreateFaceVertexCountsAttr(frame.topology.counts.tolist())
    mesh.CreateFaceVertexIndicesAttr(frame.topology.indices.tolist())
    mesh.CreateSubdivisionSchemeAttr("none")
    bones = UsdSkel.Skeleton.Define(stage, "/body/bones")
    animation = UsdSkel.Animation.Define(stage, "/body/motion")
    UsdSkel.BindingAPI.Apply(bones.GetPrim()).CreateAnimationSourceRel().SetTargets(
        [animation.GetPath()]
    )
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([bones.GetPath()])
    names, targets = [], []
    for name, offsets in shapes(frame.points).items():
        rows = np.flatnonzero(np.any(offsets != 0, axis=1))
        shape = UsdSkel.BlendShape.Define(stage, f"/body/skin/{name}")
        shape.CreateOffsetsAttr(vectors(offsets[rows]))
        shape.CreatePointIndicesAttr(rows.tolist())
        names.append(name)
        targets.append(shape.GetPath())
    binding.CreateBlendShapesAttr(names)
    binding.CreateBlendShapeTargetsRel().SetTargets(targets)
    animation.CreateBlendShapesAttr(names)
    weights = animation.CreateBlendShapeWeightsAttr()
    for time in range(FRAMES):
        turn = 2 * np.pi * (time / FRAMES - np.arange(len(names)) / len(names))
        weights.Set(Vt.FloatArray((scale * 0.5 * (1 + np.cos(turn))).tolist()), time)
    stage.GetRootLayer().Save()
    return str(path)


def vectors(values: FloatArray) -> Vt.Vec3fArray:
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values, dtype=np.float32))


def exaggerated(source: str, output: Path) -> MeshAnimation:
    """Read a stage with larger weights."""
    stage = Usd.Stage.Open(source)
    stage.Export(str(output))
    stage = Usd.Stage.Open(str(output))
    weights = UsdSkel.Animation(stage.GetPrimAtPath("/body/motion")).GetBlendShapeWeightsAttr()
    for time in weights.GetTimeSamples():
        weights.Set(Vt.FloatArray([EXAGGERATED * w for w in weights.Get(time)]), time)
    stage.Save()
    return read_stage(str(output)).meshes[0]


def off(original: MeshAnimation, marked: MeshAnimation) -> tuple[float, float]:
    """Return the distance of the farthest point, and of all (RMS): means over the frames."""
    found = []
    for before, after in zip(original, marked, strict=True):
        V = before.points
        distances = ClosestPoints(V, before.faces).distances(after.points)
        diagonal = np.linalg.norm(np.ptp(V, axis=0))
        found.append((distances.max() / diagonal, np.sqrt(np.mean(distances**2)) / diagonal))
    return tuple(np.mean(found, axis=0).tolist())


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        source = write_shaped(creature()[0], folder / "source.usdc")
        original = read_stage(source)
        marked = embed(original, KEY, recipe=recipe_from_text("apex")).asset
        more = exaggerated(source, folder / "more.usdc")
        print("| poses | planned | `keep` | `follow` |")
        print("|---|---|---|---|")
        rows = {"of the source": [off(original.meshes[0], marked.meshes[0])], "exaggerated": []}
        for primvars in ("keep", "follow"):
            output = folder / f"{primvars}.usdc"
            write_override(original, marked, output, skel="rest", primvars=primvars)
            rows["of the source"].append(off(original.meshes[0], read_stage(str(output)).meshes[0]))
            other = exaggerated(str(output), folder / f"more-{primvars}.usdc")
            rows["exaggerated"].append(off(more, other))
        for poses, found in rows.items():
            cells = [f"{most:.1e} ({rms:.1e})" for most, rms in found]
            print(f"| {' | '.join([poses, *[''] * (3 - len(cells)), *cells])} |")


if __name__ == "__main__":
    main()
