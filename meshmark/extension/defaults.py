"""What is used where nothing else is asked for; told by --help, which is to be quick."""

from __future__ import annotations

DEFAULT_SCHEME = "apex"
# What `embed` lays upon each other: found by itself, and beside the original.
DEFAULT_LAYERS = ("apex", "relief")
DEFAULT_SEGMENTER = "sdf"
DEFAULT_GEODESIC = "heat"
