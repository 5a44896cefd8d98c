"""Alignment finds the mesh, pose and map that made a copy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alignment_shapes import errors, mapped, nodding, placed, shuffled, similarity
from meshmark.alignment.align import align, align_mesh
from meshmark.alignment.copy_frames import CopyFrame
from meshmark.alignment.fit import Fit
from meshmark.alignment.original import Original
from meshmark.alignment.placement import PolynomialMap
from meshmark.alignment.poses import motion, posed
from meshmark.alignment.search import FEATURES, PCA, Search
from meshmark.arrays import FloatArray
from meshmark.errors import AlignmentError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import as_asset
from meshmark.mesh.geometry import normalized, surface_box
from meshmark.testing.meshes import bent_tube, icosphere


def test_blends_and_their_derivative_are_exact() -> None:
    original = nodding(1)
    at = posed(original, 1.25).points
    np.testing.assert_allclose(at, 0.75 * original[1].points + 0.25 * original[2].points)
    rise = posed(original, 1.75).points - at
    np.testing.assert_allclose(0.5 * motion(original, 1.25), rise, atol=1e-12)
    assert posed(original, 4.0).points is original[4].points


def crushed(kind: str) -> MeshAnimation:
    """Return a ball that is crushed, or has points far off, as flipped bits put them."""
    V, F = icosphere(3)
    V = V.copy()
    if kind == "line":
        V[:, 1:] = 0.0
    elif kind == "sheet":
        V[:, 2] = 0.0
    elif kind == "needle":
        V[:, 1:] *= 1e-6
    elif kind == "spikes":
        V[::80] *= 1e36
    else:
        F = F[:1]
    return MeshAnimation.from_arrays(V, F, prim="/Crushed")


KINDS = [
    "line",
    *(
        pytest.param(kind, marks=pytest.mark.slow)
        for kind in ("sheet", "needle", "spikes", "one face")
    ),
]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", KINDS)
def test_what_is_crushed_fits_nothing_and_nothing_fits_it(kind: str) -> None:
    tube = as_asset(nodding())
    for copy, original in ((as_asset(crushed(kind)), tube), (tube, as_asset(crushed(kind)))):
        found = align(copy, original)
        assert not found.meshes
        [unplaced] = found.unplaced
        assert unplaced.reason
        assert kind != "line" or unplaced.reason == "the mesh is scaled to a line: it has no area"


@pytest.mark.parametrize("mirror", [False, True], ids=["proper", "mirror"])
@pytest.mark.parametrize("method", ["identity", "pca"])
def test_a_similarity_is_recovered_exactly(method: str, mirror: bool) -> None:
    original, A = nodding(), similarity(3, mirror)
    copy = placed(original if method == "identity" else shuffled(original), A)
    found = align_mesh(copy, original, range(len(copy)))
    assert found.method == method
    assert errors(found, A).max() < 1e-7
    np.testing.assert_allclose([frame.pose for frame in found.frames], range(5), atol=1e-9)
    assert found.residual < 1e-7
    assert found.covered == 1.0


@pytest.mark.slow
def test_a_placement_that_only_just_fits_is_held_against_those_by_other_methods(
    monkeypatch,
) -> None:
    original, A = nodding(), similarity(3, False)
    copy = placed(shuffled(original), A)
    right = Search.place

    def place(search: Search, frame: CopyFrame, method: str) -> Fit | None:
        fit = right(search, frame, PCA)
        if method == FEATURES:
            return fit
        # Half a per cent of the diagonal off, as a part of the copy that lies elsewhere would be.
        poor = replace(fit, distances=np.full(600, 5e-3), covered=0.7)
        return poor if method == PCA else None

    monkeypatch.setattr(Search, "place", place)
    assert not place(Search((copy,), Original(original)), CopyFrame.of((copy,), 0), PCA).is_good
    for found in (
        align_mesh(copy, original, range(2)),
        *align(as_asset(copy), as_asset(original), n_frames=2).meshes,
    ):
        assert found.method == FEATURES


@settings(max_examples=10)
@given(st.integers(0, 10**6), st.booleans())
def test_any_similarity_is_recovered_from_noise(seed: int, mirror: bool) -> None:
    original, A = nodding(3, 2), similarity(seed, mirror)
    diagonal, _ = surface_box(original[0].points, original[0].faces)
    noise = np.random.default_rng(seed).normal(0.0, 1e-3 * diagonal, original[0].points.shape)
    copy = MeshAnimation.from_arrays(mapped(A, original[0].points + noise), original[0].faces)
    found = align_mesh(copy, original, [0])
    # Seven numbers from three times 642.
    assert errors(found, A).max() < 4e-4


@pytest.mark.parametrize("copies", ["same order", "shuffled"])
def test_a_frame_between_two_is_found(copies: str) -> None:
    original, A = nodding(), similarity(5)
    between = posed(original, 2.4)
    copy = MeshAnimation.from_arrays(mapped(A, between.points), between.faces)
    copy = copy if copies == "same order" else shuffled(copy)
    found = align_mesh(copy, original, [0])
    assert found.frames[0].pose == pytest.approx(2.4, abs=1e-5)
    assert errors(found, A).max() < 1e-6


def test_the_affine_map_undoes_a_stretch_and_the_cubic_one_a_bend() -> None:
    original = nodding(3, 1)
    V, F = original[0].points, original[0].faces
    diagonal, _ = surface_box(V, F)

    def left(moved: FloatArray, name: str) -> float:
        copy = MeshAnimation.from_arrays(moved, F)
        maps = align_mesh(copy, original, [0]).frames[0].maps
        return float(np.sqrt(((maps[name](moved) - V) ** 2).sum(axis=1).mean())) / diagonal

    stretched = V * (1.05, 1.0, 1.0)
    assert left(stretched, "affine") < 1e-6 < 1e-3 < left(stretched, "similarity")
    bent = V + 0.02 * diagonal * np.outer((V[:, 0] / diagonal) ** 2, [0.0, 1.0, 0.0])
    assert left(bent, "cubic") < 1e-5 < 1e-4 < left(bent, "affine")


def test_a_map_of_degree_one_is_a_matrix() -> None:
    A = similarity(1)
    P = np.random.default_rng(0).normal(size=(20, 3))
    map_ = PolynomialMap.affine(A[:, :3], A[:, 3], np.array([1.0, 2.0, 3.0]), 7.0)
    np.testing.assert_allclose(map_(P), mapped(A, P))
    np.testing.assert_allclose(map_.matrix, A)


@pytest.mark.slow
def test_another_shape_is_refused() -> None:
    V, F = bent_tube(16, 20)
    with pytest.raises(AlignmentError):
        align_mesh(MeshAnimation.from_arrays(V, F), nodding(2, 2), [0])


def test_a_remeshed_ball_may_lie_anyhow() -> None:
    ball, finer = (MeshAnimation.from_arrays(*icosphere(level)) for level in (2, 3))
    with pytest.raises(AlignmentError, match="several places"):
        align_mesh(finer, ball, [0])


def test_a_rest_of_an_ellipsoid_may_lie_anyhow() -> None:
    # It has three mirror planes: where two mirror images fit, turned copies do, too.
    V, F = icosphere(2)
    V = V * (1.0, 0.95, 0.9)
    rng = np.random.default_rng(4)
    n = normalized(rng.normal(size=(1, 3)))[0]
    G = F[(V @ n > -0.4)[F].all(axis=1)]
    rest, indices = np.unique(G, return_inverse=True)
    P = V[rest] + rng.normal(0.0, 1e-4, (len(rest), 3))
    copy = MeshAnimation.from_arrays(P, indices.reshape(G.shape))
    with pytest.raises(AlignmentError, match="several places"):
        align_mesh(copy, MeshAnimation.from_arrays(V, F), [0])
