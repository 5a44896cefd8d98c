"""Decoders of compressed data, which are installed on demand."""

from __future__ import annotations

from meshmark.errors import InputError


def missing(place: str, codec: str, package: str) -> InputError:
    """Return the error of a decoder that is not installed."""
    return InputError(
        f"{place} is compressed by {codec}, and the package {package} is not installed: "
        "pip install 'meshmark[gltf]'"
    )
