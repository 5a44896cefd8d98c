"""Built-in segmenters: ways to cut a mesh into parts, each in a package of its own."""

from __future__ import annotations

from typing import Any

from meshmark.extension.hookspecs import SegmenterRecord, hookimpl
from meshmark.extension.parameters import with_defaults

SDF_PARAMETERS = {
    "cone_angle": 120.0,
    "rays": 25,
    "clusters": 2,
    "smoothness": 0.1,
    "min_area": 0.01,
    "covariance": "tied",
}


def make_sdf(**parameters: Any) -> Any:
    """Build the segmenter by shape diameter; see `SDFSegmenter` for the parameters.

    Raises
    ------
    UsageError
        If a parameter is unknown or out of range.
    """
    values = with_defaults("segmenter sdf", SDF_PARAMETERS, parameters)
    from meshmark_plugins.segmenters.sdf import SDFSegmenter

    return SDFSegmenter(**values)


@hookimpl
def meshmark_segmenters() -> list[SegmenterRecord]:
    """Offer the built-in segmenters."""
    return [
        SegmenterRecord(
            name="sdf",
            factory=make_sdf,
            summary="parts by shape diameter: ray casting, Gaussian mixture and graph cut",
            version="1",
            parameters=SDF_PARAMETERS,
        )
    ]
