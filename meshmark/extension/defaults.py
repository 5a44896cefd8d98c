"""What is used where nothing else is asked for; told by --help, which is to be quick."""

from __future__ import annotations

DEFAULT_SCHEME = "apex"
DEFAULT_SEGMENTER = "sdf"
DEFAULT_GEODESIC = "heat"
