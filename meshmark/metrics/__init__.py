"""How much a mesh or an animation was distorted, in the measures the field reports.

Surface distances compare two triangle meshes that need not share a connectivity; the others
compare the same vertices before and after. `docs/metrics.md` has them all on one page.
"""

from meshmark.metrics.faces import flipped_faces, max_move_edges, min_angle_change, normal_turn
from meshmark.metrics.motion import flicker, flicker_world, jitter
from meshmark.metrics.summary import Distortion, distortion
from meshmark.metrics.surface_distance import SurfaceDistance, hausdorff, mrms, surface_distance
from meshmark.metrics.texture import texture_drift

__all__ = [
    "Distortion",
    "SurfaceDistance",
    "distortion",
    "flicker",
    "flicker_world",
    "flipped_faces",
    "hausdorff",
    "jitter",
    "max_move_edges",
    "min_angle_change",
    "mrms",
    "normal_turn",
    "surface_distance",
    "texture_drift",
]
