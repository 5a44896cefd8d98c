"""Compiled loops do what functions in numpy do, and are compiled by nobody's settings but ours."""

from __future__ import annotations

import importlib
import inspect
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_matrix

from meshmark import kernels
from meshmark.mesh import closest_in_triangle, deformation, flip_guard, geometry, surface_walk
from meshmark.mesh.geometry import edge_length
from meshmark.mesh.topology import faces_about_vertices
from meshmark.testing.meshes import icosphere, plane, torus
from meshmark_plugins.schemes.apex.chips import gradients, whitening
from meshmark_plugins.schemes.apex.linear_algebra import (
    block_woodbury,
    triangle_energy,
    vertex_rows,
)
from meshmark_plugins.schemes.apex.linear_algebra.vertex_rows import VertexRows
from meshmark_plugins.schemes.apex.marking import (
    energy,
    fit_to_surface,
    fold_smoother,
    sliding,
)

pytest.importorskip("numba")

MESHES = [plane(7), icosphere(2), torus(12, 9)]
# Functions that a loop stands in for.
TWINS = [
    block_woodbury.corrected,
    block_woodbury.inverted_blocks,
    block_woodbury.places_at_vertices,
    block_woodbury.seen_by_rows,
    block_woodbury.small_matrix,
    block_woodbury.sums_at_places,
    closest_in_triangle.closest_in_triangle,
    deformation.fitted_gradients,
    energy.carried_back,
    fit_to_surface.fitted_to_planes,
    fit_to_surface.points_of_triangles,
    flip_guard.shares_without_tilt,
    fold_smoother.tilted_faces,
    geometry.area_vectors,
    geometry.face_areas,
    geometry.vertex_normals,
    gradients.carried_changes,
    gradients.chip_rates,
    gradients.growth_directions,
    gradients.sampled_means,
    sliding.both_spreads,
    surface_walk.walked,
    triangle_energy.diagonal_blocks,
    triangle_energy.energy_product,
    triangle_energy.strains,
    vertex_rows.row_products,
    vertex_rows.row_sums,
    vertex_rows.squared_product,
    whitening.spread_masses_by_rows,
]
MESH_LOOPS, APEX_LOOPS = "meshmark.mesh.loops", "meshmark_plugins.schemes.apex.marking.loops"
CHIP_LOOPS = "meshmark_plugins.schemes.apex.chips.loops"
LINEAR_LOOPS = "meshmark_plugins.schemes.apex.linear_algebra.loops"
# What loops have in common.
SHARED = {"area_normal", "closest_weights", "cross", "dot", "norm"}
TOLERANCE = 1e-12


@st.composite
def crumpled_meshes(draw):
    """Draw a mesh with some of its triangles reversed, collapsed or repeated, and a generator."""
    V, F = draw(st.sampled_from(MESHES))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    V = V + draw(st.floats(0.0, 0.3)) * edge_length(V, F) * rng.normal(size=V.shape)
    F = F.copy()
    some = rng.integers(len(F), size=(3, draw(st.integers(0, 4))))
    F[some[0]] = F[some[0]][:, ::-1]
    F[some[1], 0] = F[some[1], 1]
    return V, np.concatenate([F, F[some[2]]]), rng


def agree(function: Callable[..., np.ndarray], *arguments: object) -> np.ndarray:
    """Call a function and its twin; return what both found."""
    found, wanted = function(*arguments), function.__wrapped__(*arguments)
    np.testing.assert_allclose(found, wanted, rtol=TOLERANCE, atol=TOLERANCE)
    return found


@given(crumpled_meshes())
@settings(max_examples=30)
def test_areas_and_normals(crumpled):
    """Bit by bit: whether loops are used depends on what ran before."""
    V, F, _ = crumpled
    for function in (geometry.area_vectors, geometry.face_areas, geometry.vertex_normals):
        np.testing.assert_array_equal(function(V, F), function.__wrapped__(V, F))


@given(crumpled_meshes())
@settings(max_examples=30)
def test_gradients(crumpled):
    V, F, rng = crumpled
    rings = deformation.OneRings(F, len(V))
    shapes = deformation.Deformation(V, F, rings)
    arguments = (rings.start, rings.neighbours, shapes._share, shapes._axes, shapes._known)
    moved = V @ rng.normal(size=(3, 3)) + 0.1 * rng.normal(size=V.shape)
    agree(deformation.fitted_gradients, moved, *arguments)


@given(crumpled_meshes())
@settings(max_examples=30)
def test_closest_points_in_triangles(crumpled):
    V, F, rng = crumpled
    P = V[rng.integers(len(V), size=len(F))] + 0.1 * rng.normal(size=F.shape)
    P[::5] = V[F[::5, 1]]
    find, corners = closest_in_triangle.closest_in_triangle, V[F]
    # Where two points of a triangle are as close as each other, either will do.
    both = [weigh(P, *corners.swapaxes(0, 1)) for weigh in (find, find.__wrapped__)]
    for weights in both:
        assert weights.min() >= 0.0
        np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=1e-14)
    found, wanted = (
        np.linalg.norm(np.einsum("fk,fkx->fx", weights, corners) - P, axis=1) for weights in both
    )
    np.testing.assert_allclose(found, wanted, atol=TOLERANCE)


@given(crumpled_meshes(), st.integers(0, 12))
@settings(max_examples=30)
def test_fitted_surfaces(crumpled, iterations):
    V, F, rng = crumpled
    V0, samples = V + 0.1 * rng.normal(size=V.shape), rng.dirichlet(np.ones(3), size=3)
    agree(fit_to_surface.points_of_triangles, V, F, samples)
    face = rng.integers(len(F), size=(len(F), 3))
    fit = fit_to_surface.fitted_to_planes
    agree(fit, V, F, samples, V0, F, face, 0.02, iterations, 0.0)


@given(crumpled_meshes(), st.floats(0.01, 1.0))
@settings(max_examples=30)
def test_walks(crumpled, size):
    V, F, rng = crumpled
    near = rng.integers(len(F), size=50)
    Q = V[F[near, 0]] + size * rng.normal(size=(50, 3))
    surface, border = faces_about_vertices(F), rng.random(len(V)) < 0.1
    tolerance = rng.choice([0.1 * size, np.inf], size=50)
    walk = surface_walk.walked
    arguments = (V, F, *surface, border, Q, near, tolerance)
    found, wanted = walk(*arguments), walk.__wrapped__(*arguments)
    np.testing.assert_array_equal(found < 0, wanted < 0)
    # Of triangles that are as close as each other, any will do.
    ended, find = found >= 0, closest_in_triangle.closest_in_triangle
    squares = [
        ((np.einsum("fk,fkx->fx", find(Q, *corners.swapaxes(0, 1)), corners) - Q) ** 2).sum(axis=1)
        for corners in (V[F[found]], V[F[wanted]])
    ]
    np.testing.assert_allclose(squares[0][ended], squares[1][ended], rtol=1e-9, atol=TOLERANCE)


@given(
    crumpled_meshes(),
    st.floats(0.1, 2.0),
    st.sampled_from([0.25, 0.94]),
    st.sampled_from([0.0, 0.5, 3.0]),
)
@settings(max_examples=30)
def test_shares_without_tilt(crumpled, size, least_cosine, ramp):
    V, F, rng = crumpled
    # One vertex has no face.
    V = np.concatenate([V, V[:1]])
    moved = V + size * edge_length(V, F) * rng.normal(size=V.shape)
    moved[: len(V) // 2] = V[: len(V) // 2]
    share = rng.choice([0.0, 0.5, 1.0], len(V), p=[0.05, 0.05, 0.9])
    about = faces_about_vertices(F)
    agree(flip_guard.shares_without_tilt, V, moved, F, *about, share, least_cosine, ramp)


@given(crumpled_meshes())
@settings(max_examples=30)
def test_directions(crumpled):
    V, F, rng = crumpled
    agree(gradients.growth_directions, V, F, rng.normal(size=(3, len(V))))


@given(crumpled_meshes(), st.integers(0, 12))
@settings(max_examples=30)
def test_spread_masses(crumpled, iterations):
    V, F, rng = crumpled
    areas, masses = rng.uniform(0.1, 1.0, size=(2, len(V)))
    weights = rng.uniform(0.0, 5.0, size=F.shape)
    spread = whitening.spread_masses_by_rows
    agree(spread, areas, F, weights, 0.4, masses, iterations, 1e-7)


@given(crumpled_meshes())
@settings(max_examples=30)
def test_changes_of_distances(crumpled):
    V, _, rng = crumpled
    directions, G = rng.normal(size=(2, *V.shape)), rng.normal(size=(*V.shape, 3))
    changes = gradients.carried_changes
    both = [find(directions, G, V, 0.7) for find in (changes, changes.__wrapped__)]
    for found, wanted in zip(*both, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=TOLERANCE, atol=TOLERANCE)


@given(crumpled_meshes(), st.integers(1, 6))
@settings(max_examples=30)
def test_means_over_surfaces(crumpled, n_bins):
    V, F, rng = crumpled
    areas, samples = rng.uniform(0.1, 1.0, len(F)), rng.dirichlet(np.ones(3), size=4)
    H = np.abs(rng.normal(size=(3, len(V))))
    agree(gradients.sampled_means, areas, F, H, samples, 0.4, n_bins)


@given(crumpled_meshes(), st.integers(1, 6))
@settings(max_examples=30)
def test_chips_and_their_rates(crumpled, n_bins):
    V, F, rng = crumpled
    # A vertex in each triangle, some of them at its corners.
    N, shares = len(F), rng.dirichlet(np.ones(3), size=len(F))
    shares[::7] = [0.0, 1.0, 0.0]
    H, slopes = 2.0 * rng.random(size=(3, len(V))), rng.normal(size=(3, *V.shape))
    rows, weights = 3 * np.arange(N + 1), rng.uniform(0.1, 1.0, N)
    arguments = (H, slopes, rows, F.ravel(), shares.ravel(), weights, 0.3, n_bins)
    both = [find(*arguments) for find in (gradients.chip_rates, gradients.chip_rates.__wrapped__)]
    matrices = [
        csr_matrix((values, columns, start), shape=(3 * n_bins, V.size)).toarray()
        for _, _, start, columns, values in both
    ]
    assert np.any(matrices[0])
    for found, wanted in [*zip(*(each[:2] for each in both), strict=True), matrices]:
        np.testing.assert_allclose(found, wanted, rtol=TOLERANCE, atol=TOLERANCE)
    for _, _, _, columns, _ in both:
        assert not np.any(columns[::3] % 3)
        np.testing.assert_array_equal(columns, (columns[::3, None] + np.arange(3)).ravel())


@given(crumpled_meshes())
@settings(max_examples=30)
def test_spreads(crumpled):
    V, F, _ = crumpled
    cost = sliding.SlidingCost(F)
    agree(sliding.both_spreads, V, F, cost._edges, cost._edge_at)


@given(crumpled_meshes(), st.sampled_from([0.35, 0.9]))
@settings(max_examples=30)
def test_tilted_faces(crumpled, least_cosine):
    V, F, rng = crumpled
    G, moves = rng.normal(size=(*V.shape, 3)), 0.3 * edge_length(V, F) * rng.normal(size=V.shape)
    some = rng.integers(len(F), size=20)
    agree(fold_smoother.tilted_faces, V, G, F, some, moves, least_cosine)


@given(crumpled_meshes())
@settings(max_examples=30)
def test_energies(crumpled):
    V, F, rng = crumpled
    blocks, G = rng.normal(size=(2, *V.shape, 3))
    sides, areas = rng.normal(size=F.shape), rng.uniform(0.1, 1.0, len(F))
    agree(energy.carried_back, blocks, G)
    agree(triangle_energy.energy_product, blocks, F, sides, V.ravel())
    agree(triangle_energy.diagonal_blocks, blocks, F, sides)
    agree(triangle_energy.strains, F, sides, areas, V.ravel())


@given(st.integers(0, 2**32 - 1), st.integers(1, 30), st.integers(1, 3))
@settings(max_examples=30)
def test_rows_of_vectors(seed, n, poses):
    rng = np.random.default_rng(seed)
    matrices = [rng.normal(size=(4, 3 * n)) * (rng.random((4, 3 * n)) < 0.3) for _ in range(poses)]
    rows = VertexRows.stacked(list(map(csr_matrix, matrices)))
    J = rows.starts, rows.vertices, rows.vectors
    weights, d = rng.normal(size=4 * poses), rng.normal(size=3 * n)
    weights[1] = 0.0
    agree(vertex_rows.row_products, *J, d)
    agree(vertex_rows.row_sums, *J, weights, n)
    agree(vertex_rows.squared_product, *J, weights, d)
    arguments = (*J[:2], 4, n)
    places = block_woodbury.places_at_vertices
    begins, means, place = places(*arguments)
    for found, wanted in zip((begins, means, place), places.__wrapped__(*arguments), strict=True):
        np.testing.assert_array_equal(found, wanted)
    mean = (
        begins,
        means,
        agree(block_woodbury.sums_at_places, J[0], J[2], place, weights, len(means)),
    )
    blocks = rng.normal(size=(n, 3, 3))
    blocks = blocks @ np.swapaxes(blocks, 1, 2) + np.eye(3)
    inverse = agree(block_woodbury.inverted_blocks, blocks)
    agree(block_woodbury.small_matrix, *mean, inverse, 4)
    agree(block_woodbury.seen_by_rows, *mean, inverse, d, 4)
    agree(block_woodbury.corrected, *mean, inverse, d, rng.normal(size=4))


def test_each_loop_has_a_twin_of_the_same_parameters():
    """A loop that no function uses would not be tested; one with others would go wrong."""
    public = {
        name: loop
        for loops in map(kernels.load_loops, (MESH_LOOPS, APEX_LOOPS, CHIP_LOOPS, LINEAR_LOOPS))
        for name, loop in vars(loops).items()
        if hasattr(loop, "py_func") and not name.startswith("_") and name not in SHARED
    }
    assert set(public) == {twin.__name__ for twin in TWINS}
    for twin in TWINS:
        wanted = list(inspect.signature(twin).parameters)
        assert list(inspect.signature(public[twin.__name__].py_func).parameters) == wanted


def test_loops_are_compiled_once_whatever_arrays_they_get():
    V, F = MESHES[1]
    H = np.ones((2, len(V))) * V[:, 0]
    wanted = gradients.growth_directions(V, F, H)
    fixed = V.copy()
    fixed.flags.writeable = False
    for other in (fixed, np.asfortranarray(V), np.repeat(V, 2, axis=0)[::2]):
        found = gradients.growth_directions(other, F.astype(np.int32), H)
        np.testing.assert_array_equal(found, wanted)
    assert len(kernels.load_loops(CHIP_LOOPS).growth_directions.signatures) == 1


def test_without_numba_the_twins_work(monkeypatch):
    V, F = MESHES[1]
    H = np.ones((1, len(V))) * V[:, 0]
    with_loops = gradients.growth_directions(V, F, H)
    monkeypatch.setitem(sys.modules, "numba.core.config", None)
    kernels._load_loops.cache_clear()
    try:
        assert kernels.load_loops(CHIP_LOOPS) is None
        np.testing.assert_allclose(gradients.growth_directions(V, F, H), with_loops, atol=1e-14)
    finally:
        monkeypatch.undo()
        kernels._load_loops.cache_clear()
    assert kernels.load_loops(CHIP_LOOPS) is not None


def test_a_loop_that_cannot_be_kept_is_compiled_all_the_same(monkeypatch):
    caching = importlib.import_module("numba.core.caching")
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])
    assert kernels.compile_loop(lambda x: x + 1)(2) == 3


# A module named yaml stands in for PyYAML, which need not be there.
SETTINGS = """
import sys, types, warnings
warnings.simplefilter("error")
yaml = types.ModuleType("yaml")
yaml.safe_load = lambda file: print("settings were read")
{before}sys.modules["yaml"] = yaml
from meshmark.kernels import load_loops
loops = load_loops("meshmark.mesh.loops")
sys.modules["yaml"] = yaml
import numba
numba.core.config.reload_config()
print(sys.modules["yaml"] is yaml, loops.__name__)
"""


@pytest.mark.parametrize(
    "before", ["", pytest.param("# ", marks=pytest.mark.slow)], ids=["imported", "not imported"]
)
def test_no_settings_are_read_in_the_working_directory(tmp_path: Path, before: str):
    """They might name a folder of compiled code."""
    (tmp_path / ".numba_config.yaml").write_text(f"cache_dir: {tmp_path}\n")
    done = subprocess.run(
        [sys.executable, "-P", "-c", SETTINGS.format(before=before)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
    )
    assert done.stdout == f"True {MESH_LOOPS}\n", done.stderr
    assert [path.name for path in tmp_path.iterdir()] == [".numba_config.yaml"]
