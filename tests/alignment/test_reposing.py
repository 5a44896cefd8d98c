"""Copies of the same vertices are found in poses that the original never takes."""

from __future__ import annotations

import numpy as np
import pytest

from alignment_shapes import similarity
from meshmark.alignment.align import align_mesh
from meshmark.alignment.reposing import is_posed_anew, reposed
from meshmark.arrays import FloatArray
from meshmark.detection.informed import gather_informed
from meshmark.detection.significance import judge
from meshmark.embedding.asset import embed
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset, as_asset
from meshmark.mesh.geometry import surface_box, vertex_normals
from meshmark.mesh.topology import Topology
from meshmark.testing.meshes import bent_tube, icosphere, plane

KEY, OTHER = Key(bytes(range(32))), Key(bytes(range(1, 33)))
RELIEF = [Recipe("relief")]
LENGTH = 4.0


def bent(P: FloatArray, angle: float) -> FloatArray:
    """Bend space along z, as `bent_tube` bends its cylinder."""
    bend = LENGTH / angle
    theta, r = P[:, 2] / bend, bend - P[:, 0]
    return np.stack([bend - r * np.cos(theta), P[:, 1], r * np.sin(theta)], axis=1)


@pytest.mark.parametrize(
    "shape", [icosphere(3), bent_tube(16, 40), plane(12)], ids=["ball", "tube", "flat"]
)
def test_affine_images_are_exact(shape) -> None:
    V, F = shape
    A = np.array([[1.0, 0.3, 0.0], [-0.2, 0.7, 0.4], [0.1, 0.0, 1.6]])
    Q = V @ A.T + [5.0, -3.0, 2.0]
    found = reposed(V, Q, Topology.from_triangles(F, len(V)))
    np.testing.assert_allclose(found, Q, atol=1e-9)


def test_a_bend_is_followed_but_not_what_stands_out() -> None:
    V, F = bent_tube(32, 100, angle=0.0)
    topology, Q = Topology.from_triangles(F, len(V)), bent(V, np.pi / 2)
    diagonal, _ = surface_box(Q, F)
    smooth = reposed(V, Q, topology)
    np.testing.assert_allclose(smooth, Q, atol=1e-3 * diagonal)
    height = 1e-3 * diagonal * np.random.default_rng(0).choice((-1.0, 1.0), len(V))
    n = vertex_normals(Q, F)
    stands_out = Q + height[:, None] * n
    left = ((stands_out - reposed(V, stands_out, topology)) * n).sum(axis=1)
    assert (left * height).mean() > 0.5 * (height**2).mean()


def repeated(*stack: FloatArray, F: np.ndarray) -> MeshAnimation:
    return MeshAnimation.from_arrays(np.stack(stack), F, prim="/Tube")


def test_a_pose_the_original_never_takes_is_placed() -> None:
    V, F = bent_tube(16, 60, angle=0.0)
    original = repeated(bent(V, 0.1), bent(V, 0.4), F=F)
    A = similarity(5)
    copy = repeated(*(bent(V, angle) @ A[:, :3].T + A[:, 3] for angle in (1.5, 2.5)), F=F)
    found = align_mesh(copy, original, range(2))
    assert found.method == "reposed"
    assert [tuple(frame.maps) for frame in found.frames] == [("similarity",)] * 2
    assert [frame.pose for frame in found.frames] == [1.0, 1.0]
    assert found.residual < 1e-3
    assert found.covered == 1.0


def test_another_shape_is_no_pose() -> None:
    V, F = bent_tube(16, 60, angle=0.0)
    topology = Topology.from_triangles(F, len(V))
    assert is_posed_anew(V, 3.0 * bent(V, 2.0), topology)
    rng = np.random.default_rng(0)
    for other in (V[rng.permutation(len(V))], V * [1.0, 1.0, 0.0], V * [1.0, 0.3, 1.0], 0.0 * V):
        assert not is_posed_anew(V, other, topology)


@pytest.mark.slow
def test_relief_is_read_in_a_pose_the_original_never_takes() -> None:
    V, F = bent_tube(24, 100, angle=0.0)
    original = repeated(bent(V, 0.1), bent(V, 0.4), F=F)
    marked = embed(original, KEY, recipe=RELIEF).asset.meshes[0]

    def posed_anew(mesh: MeshAnimation) -> Asset:
        """Bend the tube with what stands out of it."""
        V0, Q = original[0].points, bent(V, 2.0)
        height = ((mesh[0].points - V0) * vertex_normals(V0, F)).sum(axis=1)
        return as_asset(repeated(Q + height[:, None] * vertex_normals(Q, F), F=F))

    [found] = gather_informed(posed_anew(marked), as_asset(original), RELIEF).items
    assert found.informed.method == "reposed"
    assert judge(found, KEY).log10_p < -20
    assert judge(found, OTHER).log10_p > -3
    [nothing] = gather_informed(posed_anew(original), as_asset(original), RELIEF).items
    assert judge(nothing, KEY).log10_p > -3
