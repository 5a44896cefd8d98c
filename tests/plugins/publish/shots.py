"""What is published in the tests: small shots, marked quickly."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import meshmark
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.testing.meshes import bumpy_sphere, plane

KEY = Key(bytes(range(32)))
# In this process, and by the quickest scheme.
QUICK = {"schemes": ["cho2007"], "trusted": True}


def ball(seed: int = 0) -> MeshAnimation:
    """Animate a ball that grows, which holds a mark."""
    V, F = bumpy_sphere(3, np.eye(3))
    points = np.stack([V, (1.25 + 0.01 * seed) * V, 1.5 * V])
    return MeshAnimation.from_arrays(points, F, prim="/Ball")


def square() -> MeshAnimation:
    """Animate a square of four points, which holds none."""
    V, F = plane(2)
    return MeshAnimation.from_arrays(np.stack([V, 2.0 * V, 3.0 * V]), F, prim="/Square")


def shot(path: Path, seed: int = 0) -> Path:
    return write(path, ball(seed))


def tiny(path: Path) -> Path:
    return write(path, square())


def write(path: Path, *meshes: MeshAnimation) -> Path:
    asset = Asset(path.stem, meshes, "memory")
    path.parent.mkdir(parents=True, exist_ok=True)
    meshmark.write(asset, asset, path)
    return path


def key_file(folder: Path) -> str:
    path = folder / "studio.key"
    KEY.save(path)
    return str(path)


def is_marked(path: Path) -> bool:
    recipes, copy = [meshmark.Recipe("cho2007")], meshmark.read(path)
    return meshmark.verify(copy, KEY, recipes=recipes, recipients=["acme"]).verdict == "marked"
