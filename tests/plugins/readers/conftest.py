"""Fixtures of readers."""

from __future__ import annotations

import pytest

from meshmark_plugins.readers.gltf.reader import GltfReader


@pytest.fixture
def read(tmp_path):
    """Return a function that writes a file and reads it."""

    def save_and_read(made, **parameters):
        return GltfReader(**parameters).read(made.save(tmp_path / "made.glb"))

    return save_and_read
