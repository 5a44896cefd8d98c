"""A mark on the cage of a subdivision surface is found in the surface, at any level."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from meshmark.detection.verify import verify
from meshmark.embedding.asset import embed
from meshmark.extension.recipe import Recipe
from meshmark.extension.registry import make_attack
from meshmark.keys import Key
from meshmark.mesh.asset import Asset
from meshmark.mesh.subdivision import subdivide
from meshmark.mesh.topology import Topology
from meshmark.testing.informed_schemes import HORNS
from meshmark.testing.meshes import bumpy_sphere
from meshmark.usd.reading import read_stage
from usd_stages import array, write_text

KEY, RELIEF = Key(bytes(range(32))), Recipe("relief")
COPIES = {
    "level 1": {"steps": 1},
    "level 2": {"steps": 2},
    "limit": {"steps": 2, "limit": True},
}
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def cages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Asset]:
    """Horned balls as subdivision surfaces of a stage: of quads, and of triangles."""
    folder, found = tmp_path_factory.mktemp("cages"), {}
    V, F = bumpy_sphere(1, HORNS, 1.0, 0.35)
    W, quads = subdivide(Topology.from_triangles(F, len(V)), "catmull_clark", 2)
    fine, triangles = bumpy_sphere(3, HORNS, 1.0, 0.35)
    for rule, points, topology in (
        ("catmullClark", W @ V, quads),
        ("loop", fine, Topology.from_triangles(triangles, len(fine))),
    ):
        body = f"""
        def Mesh "cage"
        {{
            uniform token subdivisionScheme = "{rule}"
            int[] faceVertexCounts = {topology.counts.tolist()}
            int[] faceVertexIndices = {topology.indices.tolist()}
            point3f[] points = {array(points)}
        }}
        """
        found[rule] = read_stage(write_text(folder / f"{rule}.usda", body))
    return found


def found_in(marked: Asset, original: Asset, rule: str, copy: str, key: Key = KEY) -> str:
    attack = make_attack("subdivision", scheme=rule, **COPIES[copy])
    finer = attack.apply(marked.meshes[0], np.random.default_rng(0))
    leak = replace(marked, meshes=(finer,))
    return str(verify(leak, key, recipes=[RELIEF], original=original).verdict)


@pytest.mark.parametrize("scheme", ["catmullClark", "loop"])
def test_the_surface_of_a_marked_cage(cages: dict[str, Asset], scheme: str) -> None:
    original, rule = cages[scheme], {"catmullClark": "catmull_clark"}.get(scheme, scheme)
    marked = embed(original, KEY, recipe=RELIEF).asset
    assert verify(marked, KEY, recipes=[RELIEF], original=original).verdict == "marked"
    for copy in COPIES:
        assert found_in(marked, original, rule, copy) == "marked", copy
    # Neither another key nor the surface of the source is taken for it.
    assert found_in(marked, original, rule, "limit", Key(bytes(range(1, 33)))) == "not marked"
    assert found_in(original, original, rule, "limit") == "not marked"


def test_the_limit_surface_of_a_rigged_cage(data_folder: Path) -> None:
    asset = read_stage(str(data_folder / "usd" / "skel-human.usda"))
    original = replace(asset, meshes=(asset.meshes[0].select([0, 40, 80]),))
    marked = embed(original, KEY, recipe=RELIEF).asset
    assert found_in(marked, original, "catmull_clark", "limit") == "marked"
