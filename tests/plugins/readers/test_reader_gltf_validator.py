"""Written glTF files before the Khronos validator: it finds nothing that it did not find before.

It is a package of npm, `gltf-validator`; NODE_PATH says where it is installed.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from folders import TESTS
from gltf_files import QUAD, GltfFile, ball, draco_quad, quad
from meshmark.errors import UsageError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.testing.meshes import icosphere
from meshmark_plugins.readers.gltf.reader import GltfReader

# What the validator cannot see as long as Draco hides it: the man's own weights, a few of which are
# no sum of 1.
HIDDEN = Counter({"ACCESSOR_WEIGHTS_NON_NORMALIZED": 210})


@pytest.fixture(scope="session")
def validate():
    """Return a function that counts what the validator reports of files."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is absent")
    if subprocess.run([node, "-e", "require('gltf-validator')"], capture_output=True).returncode:
        pytest.skip("gltf-validator, a package of npm, is absent; set NODE_PATH to its folder")

    def run(*files: Path) -> list[Counter[str]]:
        done = subprocess.run(
            [node, str(TESTS / "gltf_validator.js"), *map(str, files)],
            capture_output=True,
            text=True,
            check=True,
            timeout=120,
        )
        return [Counter(counts) for counts in json.loads(done.stdout)]

    return run


def marked(source: Path, output: Path, *, uncompress: bool) -> Path | None:
    """Write a file with all points a little elsewhere; None where it is refused."""
    reader = GltfReader(uncompress=uncompress)
    try:
        reader.require_writable(str(source), output)
    except UsageError:
        return None
    asset = reader.read(str(source))
    rng = np.random.default_rng(0)
    meshes = []
    for mesh in asset.meshes:
        points = mesh[0].points
        moves = 1e-3 * np.ptp(points) * rng.normal(size=points.shape)
        meshes.append(mesh.map(lambda frame, moves=moves: frame.moved(frame.points + moves)))
    reader.write(replace(asset, meshes=tuple(meshes)), asset, output)
    return output


def written(sources: list[Path], folder: Path) -> list[tuple[Path, Path, bool]]:
    """Write files in all forms: (source, copy, whether it was to be plain)."""
    found = []
    for source in sources:
        for suffix in (".glb", ".gltf"):
            for uncompress in (False, True):
                output = folder / f"{source.stem}.{uncompress}{suffix}"
                copy = marked(source, output, uncompress=uncompress)
                found += [] if copy is None else [(source, copy, uncompress)]
    return found


def assert_no_worse(validate, sources: list[Path], folder: Path, hidden: Counter[str]) -> int:
    """Fail if a copy is worse than its source; return how many copies there are."""
    pairs = written(sources, folder)
    before = dict(zip(sources, validate(*sources), strict=True))
    for (source, copy, plain), after in zip(pairs, validate(*(p[1] for p in pairs)), strict=True):
        allowed = before[source] + (hidden if plain and "draco" in source.name else Counter())
        assert after <= allowed, f"{copy.name}: {after - allowed}"
    return len(pairs)


@pytest.mark.slow
def test_files_of_others(validate, data_folder, tmp_path):
    pytest.importorskip("meshopt", reason="meshopt, an optional library, is absent")
    pytest.importorskip("DracoPy", reason="DracoPy, an optional library, is absent")
    sources = sorted((data_folder / "gltf").iterdir())
    # Draco alone is not written as it is.
    assert assert_no_worse(validate, sources, tmp_path, HIDDEN) == 4 * len(sources) - 2


def sparse_quad() -> GltfFile:
    made = quad()
    listed = made.view(np.array([1, 3], "<u2").tobytes())
    values = made.view((QUAD[[1, 3]] + 0.1).astype("<f4").tobytes())
    made.json["accessors"][0] |= {
        "sparse": {
            "count": 2,
            "indices": {"bufferView": listed, "componentType": 5123},
            "values": {"bufferView": values},
        }
    }
    return made


def test_files_of_our_own(validate, tmp_path):
    sources = [tmp_path / "ball.glb", tmp_path / "quad.gltf", tmp_path / "sparse.glb"]
    for source, made in zip(sources, (ball(), quad(), sparse_quad()), strict=True):
        made.save(source)
    (tmp_path / "out").mkdir()
    assert_no_worse(validate, sources, tmp_path / "out", Counter())


def test_what_draco_hid_is_sound(validate, tmp_path):
    source = tmp_path / "draco.glb"
    draco_quad().save(source)
    assert_no_worse(validate, [source], tmp_path, Counter())


def test_new_files_have_no_fault(validate, tmp_path):
    V, F = icosphere(1)
    points = V * np.linspace(1, 2, 5)[:, None, None]
    mesh = MeshAnimation.from_arrays(points, F, prim="/A/B")
    still = MeshAnimation.from_arrays(V, F, prim="/A", times=np.array([np.nan]))
    outputs = [tmp_path / "new.glb", tmp_path / "a new.gltf"]
    for output in outputs:
        GltfReader().write_new(Asset("somewhere", (mesh, still), reader="other"), output)
    assert validate(*outputs) == [Counter(), Counter()]
