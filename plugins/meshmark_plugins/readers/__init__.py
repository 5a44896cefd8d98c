"""Built-in readers: sources that are not USD stages."""

from __future__ import annotations

from typing import Any

from meshmark.extension.hookspecs import ReaderRecord, hookimpl


def _obj(**parameters: Any) -> Any:
    from meshmark_plugins.readers.obj import ObjFrames

    return ObjFrames(**parameters)


def _gltf(**parameters: Any) -> Any:
    from meshmark_plugins.readers.gltf.reader import GltfReader

    return GltfReader(**parameters)


RECORDS = [
    ReaderRecord(
        name="obj",
        factory=_obj,
        summary="a folder or pattern of OBJ files, one a frame, or a single OBJ file",
        version="1",
        parameters={},
    ),
    ReaderRecord(
        name="gltf",
        factory=_gltf,
        summary="glTF 2.0, .glb and .gltf: skins, morph targets, one animation clip",
        version="1",
        parameters={"clip": "", "fps": 0.0, "uncompress": False, "strict": True},
    ),
]


@hookimpl
def meshmark_readers() -> list[ReaderRecord]:
    """Offer the built-in readers."""
    return list(RECORDS)
