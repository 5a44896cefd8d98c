"""Parts by shape diameter, after Shapira, Shamir and Cohen-Or (2008)."""

from __future__ import annotations

from meshmark_plugins.segmenters.sdf.diameter import shape_diameter
from meshmark_plugins.segmenters.sdf.segmenter import SDFSegmenter

__all__ = ["SDFSegmenter", "shape_diameter"]
