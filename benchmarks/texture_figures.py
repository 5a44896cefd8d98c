"""Measures and draws what `embed --primvars` does to textures, for docs/formats.md.

    python benchmarks/texture_figures.py [FILE...] [-o FOLDER]

Of each file, the first mesh is marked with the default layers, and written with `keep` and with
`follow`. A mesh without texture coordinates gets the atlas of a box: six charts, one for each side,
with a seam wherever two of them meet. The picture shows the demonstration's creature under a
checkerboard that is projected from its side.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt
from pxr import Sdf, Usd, UsdGeom, Vt

from apex_figures import save
from measuring import REPOSITORY
from meshmark import Key
from meshmark.arrays import FloatArray, IntArray
from meshmark.demo.build import write_creature
from meshmark.embedding.asset import embed
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.charts import Charts
from meshmark.mesh.geometry import area_vectors
from meshmark.metrics.texture import followed_drift, texture_drift
from meshmark.usd.reading import read_stage
from meshmark.usd.texture_coordinates import read_texture_coordinates
from meshmark.usd.writing import write_override
from render import View, render_frame

KEY = Key(bytes(range(32)))
# Checks along the longer side of the map.
CHECKS = 64
SIZE = (760, 500)
LIGHT, DARK, RED = (0.92, 0.9, 0.86), (0.16, 0.2, 0.3), "#c0392b"
# Width of the close-up, as a share of that of the whole picture.
CLOSE_UP = 0.16


@dataclass(frozen=True, eq=False)
class Written:
    """A marked mesh as it was read, and as it was written with `keep` and with `follow`."""

    original: MeshAnimation
    marked: MeshAnimation
    cost: float
    source: str
    output: str

    def before(self, time: float) -> FloatArray:
        """Return the texture coordinates (F, 3, 2) of the source."""
        return coordinates(self.source, self.original.prim, time)

    def after(self, time: float) -> FloatArray:
        """Return those that were written with `follow`."""
        return coordinates(self.output, self.original.prim, time)

    def drifts(self) -> dict[str, tuple[float, float]]:
        """Measure the drift of the farthest vertex, and of all (RMS): means over the frames."""
        times = self.original.times.tolist()
        mean = np.mean([self.after(t) for t in times], axis=0)
        found: dict[str, list[tuple[float, float]]] = {"keep": [], "one": [], "follow": []}
        charts = Charts.of_corners(self.original[0].faces, self.before(times[0]))
        for index, t in enumerate(times):
            V, X = self.original[index].points, self.marked[index].points
            UV = self.before(t)
            kept = texture_drift(V, X, charts.faces, UV)
            one, followed = (followed_drift(V, X, charts, UV, UV1) for UV1 in (mean, self.after(t)))
            for name, drift in (("keep", kept), ("one", one), ("follow", followed)):
                found[name].append((float(drift.max()), float(np.sqrt(np.mean(drift**2)))))
        return {name: tuple(np.mean(each, axis=0).tolist()) for name, each in found.items()}


def with_coordinates(file: Path, folder: Path) -> str:
    """Return a stage that has texture coordinates: of its own, or those of a box."""
    mesh = read_stage(str(file)).meshes[0]
    if read_texture_coordinates(str(file), mesh.prim) is not None:
        return str(file)
    frame = mesh[0]
    uv = box_atlas(frame.points, frame.topology.triangles)
    assert np.all(frame.topology.counts == 3), "the box is for triangles"
    return lay_coordinates(file, folder, mesh.prim, uv.reshape(-1, 2), "faceVarying")


def lay_coordinates(file: Path, folder: Path, prim: str, uv: FloatArray, interpolation: str) -> str:
    """Write a layer over a stage that gives a mesh texture coordinates."""
    output = folder / f"{file.stem}-mapped.usda"
    stage = Usd.Stage.CreateNew(str(output))
    stage.GetRootLayer().subLayerPaths.append(str(file.resolve()))
    source = Usd.Stage.Open(str(file))
    stage.SetMetadata("upAxis", UsdGeom.GetStageUpAxis(source))
    stage.SetTimeCodesPerSecond(source.GetTimeCodesPerSecond())
    kind = Sdf.ValueTypeNames.TexCoord2fArray
    st = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(prim)).CreatePrimvar("st", kind, interpolation)
    st.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(uv, dtype=np.float32)))
    stage.GetRootLayer().Save()
    return str(output)


def box_atlas(V: FloatArray, F: IntArray) -> FloatArray:
    """Project each triangle along the axis it faces most, into one of six tiles, (F, 3, 2)."""
    normals = area_vectors(V, F)
    axis = np.abs(normals).argmax(axis=1)
    side = normals[np.arange(len(F)), axis] > 0
    P = (V - V.min(axis=0)) / np.ptp(V, axis=0).max()
    others = np.array([[1, 2], [0, 2], [0, 1]])[axis]
    uv = np.take_along_axis(P[F], np.repeat(others[:, None], 3, axis=1), axis=2)
    return (uv + np.stack([axis, side.astype(int)], axis=1)[:, None]) / 3


def written(source: str, folder: Path) -> list[Written]:
    """Mark the first mesh of a stage, and write it both ways; with its rig, too, if it has one."""
    asset = read_stage(source)
    mesh = asset.meshes[0]
    cost = {}
    start = time.process_time()
    marked = embed(Asset(asset.source, (mesh,), asset.reader, asset.up_axis), KEY, jobs=1).asset
    cost["embed"] = time.process_time() - start
    found = []
    for skel in ("bake", "rest") if mesh.notes else ("bake",):
        for primvars in ("keep", "follow"):
            start = time.process_time()
            output = folder / f"{Path(source).stem}-{skel}-{primvars}.usdc"
            write_override(asset, marked, output, skel=skel, primvars=primvars)
            cost[primvars] = cost["embed"] + time.process_time() - start
        (shown,) = read_stage(str(output), [mesh.prim]).meshes
        found.append(Written(mesh, shown, cost["follow"] / cost["keep"], source, str(output)))
    return found


def coordinates(source: str, prim: str, time: float) -> FloatArray:
    found = read_texture_coordinates(source, prim, time=time)
    assert found is not None
    return found


def print_rows(file: Path, folder: Path) -> None:
    source = with_coordinates(file, folder)
    for done, skel in zip(written(source, folder), ("", ", `--skel rest`"), strict=False):
        drifts = done.drifts()
        cells = [f"{largest:.1f} ({rms:.2f})" for largest, rms in drifts.values()]
        share = 100 * drifts["follow"][0] / drifts["keep"][0]
        cells = [f"`{file.name}`{skel}", *cells, f"{share:.1f} %", f"{done.cost:.2f}"]
        print(f"| {' | '.join(cells)} |", flush=True)


def draw(path: Path, folder: Path) -> None:
    """Draw the creature's checkerboard as it was, with `keep`, and with `follow`."""
    file = write_creature(folder)
    mesh = read_stage(str(file)).meshes[0]
    P = mesh[0].points
    uv = (P - P.min(axis=0))[:, :2] / np.ptp(P[:, :2], axis=0).max()
    [done] = written(lay_coordinates(file, folder, mesh.prim, uv, "vertex"), folder)
    t = float(mesh.times[0])
    V, X, F = P, done.marked[0].points, mesh[0].faces
    UV, UV1 = done.before(t), done.after(t)
    drift = texture_drift(V, X, F, UV)
    followed = followed_drift(V, X, Charts.of_corners(F, UV), UV, UV1)
    print(f"picture: keep {drift.max():.1f}, follow {followed.max():.2f} texels")
    whole = View(azimuth=0.0, elevation=0.0)
    span = 1.06 * float(np.ptp(V[:, 0]))
    near = View(0.0, 0.0, tuple(focus(V, F, drift, CLOSE_UP * span)), CLOSE_UP * span)
    versions = (
        ("original", V, UV),
        ("marked, --primvars keep", X, UV),
        ("marked, --primvars follow", X, UV1),
    )
    figure, axes = plt.subplots(2, 3, figsize=(12.6, 5.9), layout="constrained")
    for column, (title, points, shown) in zip(axes.T, versions, strict=True):
        for ax, view in zip(column, (whole, near), strict=True):
            ax.imshow(render_frame(points, F, colors=checks(shown), view=view, size=SIZE))
            ax.set(xticks=[], yticks=[])
        column[0].set_title(title, fontsize=11)
        for spine in column[1].spines.values():
            spine.set(color=RED, linewidth=2)
    save(figure, path)


def focus(V: FloatArray, F: IntArray, drift: FloatArray, width: float) -> FloatArray:
    """Choose the place, seen from the side and facing the eye, about which most slid."""
    normals = np.zeros_like(V)
    np.add.at(normals, F.reshape(-1), np.repeat(area_vectors(V, F), 3, axis=0))
    front = normals[:, 2] > 0.8 * np.linalg.norm(normals, axis=1)
    best, chosen = -1.0, V[0]
    for v in np.flatnonzero(front)[::5]:
        about = front & (np.abs(V[:, :2] - V[v, :2]).max(axis=1) < width / 3)
        if (total := float(drift[about].sum())) > best:
            best, chosen = total, V[v]
    return chosen


def checks(UV: FloatArray) -> Callable[[IntArray, FloatArray], FloatArray]:
    def paint(face: IntArray, weights: FloatArray) -> FloatArray:
        uv = np.einsum("ni,nix->nx", weights, UV[face])
        odd = np.floor(uv * CHECKS).sum(axis=1).astype(int) % 2 == 1
        return np.where(odd[:, None], DARK, LIGHT)

    return paint


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("-o", "--output", type=Path, default=REPOSITORY / "docs" / "formats")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        print("| file | `keep` | one value | `follow` | share left | CPU |")
        print("|---|---|---|---|---|---|")
        for file in options.files:
            print_rows(file, Path(name))
        draw(options.output / "checkerboard.png", Path(name))


if __name__ == "__main__":
    main()
