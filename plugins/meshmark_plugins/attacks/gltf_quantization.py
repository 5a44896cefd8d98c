"""What a glTF optimiser leaves of the positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.mesh.animation import MeshAnimation
from meshmark_plugins.attacks.parameters import whole
from meshmark_plugins.attacks.quantization import RoundToGrid, bounding_box


@dataclass(frozen=True)
class GltfQuantization:
    """Store positions as unsigned integers under one node transform for the whole animation.

    Unlike `quantization`, the step is the same on all axes, because the transform that brings
    integers back scales evenly.

    Parameters
    ----------
    bits : int
        Bits of a coordinate, in [1, 16]; 14 is what optimisers choose, 16 is all the format has.

    Raises
    ------
    UsageError
        If the parameter is out of range.

    References
    ----------
    Khronos Group, glTF extension KHR_mesh_quantization.
    """

    bits: int = 16

    def __post_init__(self) -> None:
        object.__setattr__(self, "bits", whole("gltf-quantization", "bits", self.bits, 1, 16))

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the quantized animation."""
        low, high = bounding_box(animation)
        step = float((high - low).max()) / (2**self.bits - 1)
        return animation.map(RoundToGrid(low, np.full(3, step)))
