"""A square sheet as a stage, with whatever hangs on it, and slides along it, for the tests."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from meshmark.mesh.asset import Asset
from meshmark.testing.meshes import plane
from meshmark.usd.delivery import write_flattened
from meshmark.usd.reading import read_stage
from meshmark.usd.writing import write_override

Write = Callable[..., object]
WRITERS = [write_override, write_flattened]
T = Sdf.ValueTypeNames
TIMES = (1.0, 2.0, 4.0)
V, F = plane(13)
INNER = np.all((V[:, :2] > 0) & (V[:, :2] < 1), axis=1)
# At most a seventh of an edge, and none at the border.
SLIDE = np.column_stack([np.sin(3 * V[:, 1] + 1), np.cos(4 * V[:, 0]), 0 * V[:, 0]]) * 0.012
SLIDE *= INNER[:, None]


def vectors(array: np.ndarray, kind: str = "Vec3f") -> object:
    dtype = {"h": np.float16, "f": np.float32, "d": np.float64}[kind[-1]]
    return getattr(Vt, f"{kind}Array").FromNumpy(np.ascontiguousarray(array, dtype=dtype))


class Sheet:
    """A stage with a mesh `/sheet`; by default a square that bulges with time."""

    def __init__(self, path: Path, points: Mapping[float, np.ndarray] | np.ndarray, faces=F):
        self.stage = Usd.Stage.CreateNew(str(path))
        self.mesh = UsdGeom.Mesh.Define(self.stage, "/sheet")
        if isinstance(points, np.ndarray):
            self.mesh.CreatePointsAttr(vectors(points))
        else:
            for time, each in points.items():
                self.mesh.CreatePointsAttr().Set(vectors(each), time)
        self.mesh.CreateFaceVertexCountsAttr([3] * len(faces))
        self.mesh.CreateFaceVertexIndicesAttr(faces.ravel().tolist())
        self.mesh.CreateSubdivisionSchemeAttr("none")

    def primvar(self, name: str, kind: Sdf.ValueTypeName, interpolation: str, value=None):
        made = UsdGeom.PrimvarsAPI(self.mesh).CreatePrimvar(name, kind, interpolation)
        if value is not None:
            made.Set(value)
        return made

    def save(self) -> str:
        self.stage.GetRootLayer().Save()
        return str(self.stage.GetRootLayer().realPath)


def flat(n: int = len(TIMES)) -> dict[float, np.ndarray]:
    """Show the square, moved on as a whole with time: barycentric coordinates stay."""
    return {time: V + index * np.eye(3)[2] for index, time in enumerate(TIMES[:n])}


def slid(asset: Asset, moves: Callable[[float], np.ndarray]) -> Asset:
    return replace(
        asset,
        meshes=tuple(
            mesh.map(lambda f: f.moved(f.points + moves(f.time))) for mesh in asset.meshes
        ),
    )


def written(source: str, write: Write, moves: Callable[[float], np.ndarray], **options: object):
    original = read_stage(source)
    # A layer that is open would not be read again.
    output = Path(source).with_name(f"out-{write.__name__}-{next(NUMBERS)}.usdc")
    write(original, slid(original, moves), output, **options)
    return Usd.Stage.Open(str(output))


def value(stage: Usd.Stage, name: str, time: float | None = None, prim: str = "/sheet"):
    attribute = stage.GetPrimAtPath(prim).GetAttribute(name)
    code = Usd.TimeCode.Default() if time is None else time
    primvar = UsdGeom.Primvar(attribute)
    return np.array(primvar.ComputeFlattened(code) if primvar else attribute.Get(code))


def growing(time: float) -> np.ndarray:
    return SLIDE * (time - 1)


NUMBERS = count()
RNG = np.random.default_rng(0)
PAIRS = RNG.random((len(V), 2))


def elements(interpolation: str) -> np.ndarray:
    """Return the vertex of each element of the square."""
    return F.ravel() if interpolation == "faceVarying" else np.arange(len(V))
