"""What tests of written glTF files share: a mark that is easy to tell."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from meshmark.mesh.asset import Asset
from meshmark.sources.writing import writer
from meshmark_plugins.readers.gltf.container import read_container
from meshmark_plugins.readers.gltf.reader import GltfReader

SHIFT = np.array([0.5, 0.25, 1.0])


def shifted(asset: Asset) -> Asset:
    """Move all points by the same."""
    moved = (mesh.map(lambda frame: frame.moved(frame.points + SHIFT)) for mesh in asset.meshes)
    return replace(asset, meshes=tuple(moved))


def mark(source: str, output: Path, **parameters) -> dict:
    """Shift the meshes of a file, write it, check what is read back; return the document."""
    reader = GltfReader(**parameters)
    asset = reader.read(source)
    writer(asset, output, parameters=parameters)(shifted(asset))
    for mesh, found in zip(asset.meshes, GltfReader().read(str(output)).meshes, strict=True):
        np.testing.assert_allclose(found[0].points, mesh[0].points + SHIFT, atol=1e-6)
    return dict(read_container(output).root.members)


def bounds(accessor: dict) -> list:
    """Return what an accessor says of its least and largest values."""
    return [accessor["min"], accessor["max"]]
