"""Small stages for the tests of meshmark.usd, and marks to put on them."""

from __future__ import annotations

import hashlib
import textwrap
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd, Vt

from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.usd.reading import read_stage

CUBE_POINTS = np.array(
    [[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)], dtype=np.float32
)
CUBE_COUNTS = [4] * 6
CUBE_INDICES = [0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5]


FRAMES = {1: CUBE_POINTS, 2: CUBE_POINTS + 1, 4.5: CUBE_POINTS * 2}


def write_text(path: Path, body: str, metadata: str = "") -> str:
    """Write a text layer and return its path."""
    header = f"#usda 1.0\n(\n{textwrap.dedent(metadata)}\n)\n"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(header + textwrap.dedent(body))
    return str(path)


def array(points: np.ndarray) -> str:
    """Spell (N, 3) points as a text layer does."""
    return "[" + ", ".join(f"({x:.9g}, {y:.9g}, {z:.9g})" for x, y, z in points.tolist()) + "]"


def cube(name: str = "cube", points: str | None = None, more: str = "", kind: str = "def") -> str:
    """Return the text of a cube of six quads; `points` replaces its points statement."""
    return f"""
    {kind} Mesh "{name}"
    {{
        int[] faceVertexCounts = {CUBE_COUNTS}
        int[] faceVertexIndices = {CUBE_INDICES}
        {points or f"point3f[] points = {array(CUBE_POINTS)}"}
        {more}
    }}
    """


def sampled(frames: dict[float, np.ndarray]) -> str:
    """Return the statement of time-sampled points."""
    samples = ", ".join(f"{time:g}: {array(points)}" for time, points in frames.items())
    return f"point3f[] points.timeSamples = {{ {samples} }}"


def moved(asset: Asset, seed: int = 0) -> Asset:
    """Move every other point of every frame by about a thousandth, and leave the rest."""

    def move(frame: Frame) -> Frame:
        clock = 0 if np.isnan(frame.time) else int(1000 * frame.time)
        step = np.random.default_rng([seed, clock]).normal(0, 1e-3, frame.points.shape)
        step[::2] = 0
        return frame.moved(frame.points + step)

    return replace(asset, meshes=tuple(mesh.map(move) for mesh in asset.meshes))


def float_arrays(layer: Sdf.Layer) -> Iterator[tuple[str, bytes]]:
    """Yield the path and bytes of every array of vectors anywhere in a layer."""
    paths: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    for path in paths:
        spec = layer.GetAttributeAtPath(path) if path.IsPropertyPath() else None
        if spec is None:
            continue
        times = layer.ListTimeSamplesForPath(path)
        for value in (spec.default, *(layer.QueryTimeSample(path, time) for time in times)):
            if isinstance(value, Vt.Vec3fArray):
                yield str(path), np.asarray(value).tobytes()


def points_at(stage: Usd.Stage, prim: str, time: float | None = None) -> np.ndarray:
    """Return a prim's points as the stage shows them."""
    attribute = stage.GetPrimAtPath(prim).GetAttribute("points")
    value = attribute.Get() if time is None else attribute.Get(time)
    return np.array(value)


def digest(path: Path) -> str:
    """Return a hash of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def infinite(frame: Frame) -> Frame:
    """Send the frame at time 2 to infinity."""
    return frame.moved(frame.points * np.inf) if frame.time == 2 else frame


def read_one(source: str) -> MeshAnimation:
    """Read a source that holds one mesh."""
    (mesh,) = read_stage(source).meshes
    return mesh


def nested_references(levels: int) -> str:
    """Spell a stage of 2^levels meshes in a few hundred bytes."""
    body = f'def "L0" {{{cube("m")}}}\n'
    for level in range(levels):
        twice = "".join(f"def {name} (references=</L{level}>) {{}}\n" for name in ('"a"', '"b"'))
        body += f'def "L{level + 1}" {{\n{twice}}}\n'
    return body
