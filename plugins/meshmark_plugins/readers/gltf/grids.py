"""Whether the grid that quantised positions are on is fine enough for a mark."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np

from meshmark.errors import InputError, UsageError
from meshmark_plugins.readers.gltf.accessors import Accessors, stored_type
from meshmark_plugins.readers.gltf.buffers import Buffers
from meshmark_plugins.readers.gltf.container import Container
from meshmark_plugins.readers.gltf.element import Element
from meshmark_plugins.readers.gltf.geometry import POSITION

# Steps of a grid, as a share of the diagonal. Measured on CesiumMan.quantized.glb, 61 frames, both
# default layers, with fewer bits: log10 p of what was written.
#
# step       4.8e-5  1.9e-4  3.8e-4  7.7e-4  1.5e-3  3.1e-3
# log10 p    -90.5   -56.8   -25.1   -11.3   -9.4    -7.2
#
# From 7.7e-4 on, relief is lost, and only apex is found.
COARSEST = 5e-4


def require_fine(container: Container, folder: Path) -> None:
    """Refuse meshes whose positions are on a grid that loses marks.

    Raises
    ------
    UsageError
        If there is one.
    """
    buffers = Buffers(container, folder)
    accessors = Accessors(container.root, buffers)
    for mesh in container.root.objects("meshes"):
        # What cannot be read holds no mark, and is told of elsewhere.
        with suppress(InputError):
            share = _step(mesh, accessors)
            if share > COARSEST:
                raise UsageError(
                    f"{mesh.place} is on a grid of {share:.1g} of its size, too coarse for a mark; "
                    "--uncompress writes it without"
                )


def _step(mesh: Element, accessors: Accessors) -> float:
    """Return how far apart quantised positions are, as a share of the diagonal; 0 for floats."""
    step = 0.0
    boxes = []
    for primitive in mesh.objects("primitives"):
        index = primitive.object("attributes").index(POSITION, accessors.elements)
        accessor = accessors.elements[index]
        dtype = stored_type(accessor)
        if dtype.kind != "f":
            step = 1 / np.iinfo(dtype).max if accessor.flag("normalized") else 1.0
            points = accessors.numbers(index, 3)
            boxes += [points.min(axis=0), points.max(axis=0)]
    diagonal = float(np.linalg.norm(np.ptp(boxes, axis=0))) if boxes else 0.0
    return step / diagonal if diagonal else 0.0
