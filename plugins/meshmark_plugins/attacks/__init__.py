"""Built-in attacks: what thieves, pipelines and accidents do to an animation.

Each lives in a module of its own, named after it; docs/attacks.md says what it models.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from importlib import import_module
from typing import Any

from meshmark.extension.hookspecs import AttackRecord, hookimpl
from meshmark.extension.parameters import require_known


@dataclass(frozen=True)
class AttackFactory:
    """Imports an attack's module only when the attack is wanted, and builds it."""

    name: str
    module: str
    attack: str

    def __call__(self, **parameters: Any) -> Any:
        """Build the attack; raise UsageError for a parameter it does not have."""
        kind = getattr(import_module(f"{__name__}.{self.module}"), self.attack)
        require_known(f"attack {self.name}", [field.name for field in fields(kind)], parameters)
        return kind(**parameters)


def _record(
    name: str, attack: str, summary: str, parameters: Mapping[str, Any] | None = None
) -> AttackRecord:
    return AttackRecord(
        name=name,
        factory=AttackFactory(name, name.replace("-", "_"), attack),
        summary=summary,
        version="1",
        parameters=dict(parameters or {}),
    )


RECORDS = [
    _record(
        "noise",
        "Noise",
        "random displacement of every coordinate, a share of the mean distance to the centre",
        {"amplitude": 0.001, "kind": "uniform", "per": "frame"},
    ),
    _record(
        "quantization",
        "Quantization",
        "coordinates rounded to a grid over the bounding box",
        {"bits": 10, "per": "frame"},
    ),
    _record(
        "gltf-quantization",
        "GltfQuantization",
        "positions as integers under one transform, as KHR_mesh_quantization stores them",
        {"bits": 16},
    ),
    _record(
        "float16",
        "Float16",
        "positions stored in half precision",
    ),
    _record(
        "obj-digits",
        "ObjDigits",
        "positions written as text with few digits",
        {"digits": 4, "kind": "fixed"},
    ),
    _record(
        "similarity",
        "Similarity",
        "random move, turn and uniform scale",
        {"translation": 5.0, "scale_low": 0.1, "scale_high": 10.0, "per": "animation"},
    ),
    _record(
        "scale",
        "Scale",
        "another scale along each axis",
        {"strength": 0.1, "factors": None},
    ),
    _record(
        "smoothing",
        "Smoothing",
        "umbrella or Taubin smoothing",
        {"iterations": 10, "kind": "umbrella", "strength": 0.1},
    ),
    _record(
        "relaxation",
        "Relaxation",
        "vertices evened out along the surface, which stays",
        {"steps": 5, "strength": 1.0},
    ),
    _record(
        "jitter",
        "Jitter",
        "vertices moved at random along the surface, which stays",
        {"size": 1.0, "per": "animation"},
    ),
    _record(
        "wobble",
        "Wobble",
        "smooth waves through the shape",
        {"amplitude": 0.01, "waves": 3, "wavelength": 2.0, "per": "animation"},
    ),
    _record(
        "bending",
        "Bending",
        "the whole shape bent along a parabola or a cubic",
        {"amount": 0.01, "degree": 2, "per": "animation"},
    ),
    _record(
        "embossing",
        "Embossing",
        "a random low relief along the normals",
        {"height": 1e-4, "patches": 400},
    ),
    _record(
        "simplification",
        "Simplification",
        "edges collapsed where the error is smallest",
        {"ratio": 0.3, "method": "quadric", "per": "animation"},
    ),
    _record(
        "subdivision",
        "Subdivision",
        "midpoint, Loop, sqrt(3) or Catmull-Clark subdivision",
        {"scheme": "midpoint", "steps": 1, "limit": False},
    ),
    _record(
        "cropping",
        "Cropping",
        "cuts a share of the vertices away with a plane",
        {"share": 0.1, "direction": None, "per": "animation"},
    ),
    _record(
        "joining",
        "Joining",
        "a ground, a box, a body, a hidden sheet or a wall made part of the mesh",
        {"thing": "ground", "size": 3.0, "area": 5.0},
    ),
    _record(
        "cutting",
        "Cutting",
        "cut into pieces that hardly move",
        {"patches": 12, "gap": 1e-6},
    ),
    _record(
        "reorder",
        "Reorder",
        "vertices and faces in random order",
        {"per": "animation"},
    ),
    _record(
        "remeshing-isotropic",
        "RemeshingIsotropic",
        "triangles of even size on the same surface (needs gpytoolbox)",
        {"edge": 1.0, "iterations": 10, "per": "animation"},
    ),
    _record(
        "remeshing-sdf",
        "RemeshingSdf",
        "marching cubes on the signed distance field",
        {"resolution": 128, "per": "animation"},
    ),
    _record(
        "resample",
        "Resample",
        "every k-th frame kept, the others restored by linear interpolation",
        {"factor": 2},
    ),
    _record(
        "drop",
        "Drop",
        "frames removed at random",
        {"share": 0.25},
    ),
    _record(
        "junk",
        "Junk",
        "frames whose points are scrambled",
        {"share": 0.5, "where": "start"},
    ),
    _record(
        "window",
        "Window",
        "consecutive frames kept, the rest cut off",
        {"share": 0.5, "start": None},
    ),
    _record(
        "speed",
        "Speed",
        "played faster or slower, and sampled anew",
        {"factor": 1.25, "bake": True},
    ),
    _record(
        "reverse",
        "Reverse",
        "played backwards",
    ),
    _record(
        "combination",
        "Combination",
        "several attacks one after the other",
        {"attacks": "quantization:bits=12+smoothing:iterations=5+similarity"},
    ),
    _record(
        "collusion",
        "Collusion",
        "differently marked copies averaged, mixed or alternated",
        {"other": None, "kind": "mean"},
    ),
    _record(
        "marking-again",
        "MarkingAgain",
        "marked with another key, or the mean of copies marked so",
        {"copies": 1},
    ),
]


@hookimpl
def meshmark_attacks() -> list[AttackRecord]:
    """Offer the built-in attacks."""
    return list(RECORDS)
