"""Meshes whose faces share no points: marked as one surface, written back as they were."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gltf_files import GltfFile
from meshmark import Key, mark_file, read, verify
from meshmark.arrays import IntArray
from meshmark.embedding.asset import embed
from meshmark.extension.recipe import Recipe
from meshmark.mesh.animation import MeshAnimation
from meshmark.testing.informed_schemes import horned
from meshmark.testing.meshes import icosphere
from usd_stages import array, write_text

KEY, OTHER = Key(bytes(range(32))), Key(bytes(range(1, 33)))
RELIEF = [Recipe("relief")]
V, F = icosphere(2)


def stage(folder: Path) -> str:
    """Write a ball of which every face has points of its own, turned and in another unit."""
    points = ", ".join(f"{time}: {array((V + 0.1 * time)[F].reshape(-1, 3))}" for time in (1, 2))
    return write_text(
        folder / "ball.usda",
        f"""
        def Xform "World"
        {{
            double3 xformOp:translate = (3, 1, -2)
            float3 xformOp:rotateXYZ = (20, 30, 40)
            float3 xformOp:scale = (0.7, 0.7, 0.7)
            uniform token[] xformOpOrder = [
                "xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"
            ]
            def Mesh "ball"
            {{
                int[] faceVertexCounts = {[3] * len(F)}
                int[] faceVertexIndices = {list(range(F.size))}
                point3f[] points.timeSamples = {{ {points} }}
            }}
        }}
        """,
    )


def glb(folder: Path) -> str:
    """Write a ball whose normals are split: its points are not even indexed."""
    made = GltfFile()
    corners = V[F].reshape(-1, 3).astype("f4")
    normals = np.repeat(V[F].mean(axis=1), 3, axis=0)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    primitive = made.primitive(corners, None, NORMAL=made.accessor(normals))
    made.add("nodes", mesh=made.mesh(primitive), name="ball", translation=[1, 2, 3])
    return made.save(folder / "ball.glb")


def coincident(mesh: MeshAnimation, index: int) -> IntArray:
    """Number the places of a frame's points, (N,)."""
    return np.unique(mesh[index].points, axis=0, return_inverse=True)[1].reshape(-1)


def places(mesh: MeshAnimation, index: int) -> IntArray:
    """Number the places of a frame's points, (N,), in the order of their first points."""
    _, first, of = np.unique(mesh[index].points, axis=0, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[of.reshape(-1)]


@pytest.mark.parametrize(
    ("source", "output"),
    [
        pytest.param(stage, "marked.usda", id="usd"),
        pytest.param(glb, "marked.glb", id="gltf", marks=pytest.mark.slow),
    ],
)
def test_points_that_lay_together_lie_together(tmp_path: Path, source, output: str) -> None:
    path = source(tmp_path)
    manifest = mark_file(path, tmp_path / output, KEY, recipe=RELIEF)
    assert manifest.document["verification"]["verdict"] == "marked"
    [before], [after] = read(path).meshes, read(tmp_path / output).meshes
    assert before[0].topology.n_points == F.size
    assert after[0].topology.same_as(before[0].topology)
    for index in range(len(before)):
        assert places(before, index).max() + 1 == len(V)
        # Exactly, and no two that lay apart do.
        np.testing.assert_array_equal(places(after, index), places(before, index))
        assert np.all(np.any(after[index].points != before[index].points, axis=1))


@pytest.mark.slow
def test_a_copy_that_a_leak_has_unwelded_is_marked() -> None:
    [copy] = embed(horned(), KEY, recipe=RELIEF).asset.meshes
    faces = copy[0].faces
    soup = MeshAnimation.from_arrays(
        np.stack([frame.points[faces].reshape(-1, 3) for frame in copy]),
        np.arange(faces.size).reshape(-1, 3),
    )
    assert verify(soup, KEY, recipes=RELIEF, original=horned()).verdict == "marked"
    assert verify(soup, OTHER, recipes=RELIEF, original=horned()).verdict == "not marked"
