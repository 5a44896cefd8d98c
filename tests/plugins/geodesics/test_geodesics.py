"""Heat, dijkstra and exact: the suite of every solver, and what each promises beyond it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshmark.errors import CapacityError, InputError, UsageError
from meshmark.testing.geodesics import GeodesicSolverSuite
from meshmark.testing.meshes import cylinder, icosphere, plane, side_by_side, torus
from meshmark_plugins.geodesics import meshmark_geodesic_solvers
from meshmark_plugins.geodesics.dijkstra import DijkstraSolver
from meshmark_plugins.geodesics.exact import ExactSolver
from meshmark_plugins.geodesics.heat import HeatSolver

SOLVERS = [HeatSolver, DijkstraSolver, ExactSolver]
RECORDS = {record.name: record for record in meshmark_geodesic_solvers()}


class TestHeat(GeodesicSolverSuite):
    @pytest.fixture
    def solver_factory(self):
        return RECORDS["heat"].factory


class TestHeatWithoutDelaunay(GeodesicSolverSuite):
    @pytest.fixture
    def solver_factory(self):
        return lambda V, F: HeatSolver(V, F, use_robust=False)


class TestDijkstra(GeodesicSolverSuite):
    @pytest.fixture
    def solver_factory(self):
        return RECORDS["dijkstra"].factory

    @pytest.fixture
    def relative_error(self):
        return 0.12

    @pytest.fixture
    def repeatability(self):
        return 1e-12


class TestExact(GeodesicSolverSuite):
    @pytest.fixture
    def solver_factory(self):
        return RECORDS["exact"].factory

    @pytest.fixture
    def relative_error(self):
        return 0.002


def test_exact_on_a_right_triangle_by_hand():
    V = np.array([[0.0, 0, 0], [3, 0, 0], [3, 4, 0]])
    np.testing.assert_allclose(ExactSolver(V, [[0, 1, 2]]).distances([0]), [[0, 3, 5]])


def test_exact_across_a_unit_cube_unfolds_two_faces():
    V = np.array([[x, y, z] for x in (0.0, 1) for y in (0, 1) for z in (0, 1)])
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    F = np.array([t for a, b, c, d in quads for t in ([a, b, c], [a, c, d])])
    D = ExactSolver(V, F).distances([0])[0]
    steps = V.sum(axis=1)
    np.testing.assert_allclose(D[steps == 1], 1.0)
    np.testing.assert_allclose(D[steps == 2], np.sqrt(2.0))
    np.testing.assert_allclose(D[steps == 3], np.sqrt(5.0))


def test_exact_on_a_cylinder_unrolls_it():
    n, m, height = 40, 21, 4.0
    V, F = cylinder(n, m, 1.0, height)
    D = ExactSolver(V, F).distances([10 * n])[0][: n * m]
    # Even rings are alike; from the middle one no shortcut leads over a cap.
    even = np.repeat(np.arange(m) % 2 == 0, n)
    angle = np.abs(np.arctan2(V[:, 1], V[:, 0]))[: n * m]
    straight = np.hypot(angle, V[: n * m, 2] - height / 2.0)
    near = even & (angle < 1.5)
    np.testing.assert_allclose(D[near], straight[near], rtol=3e-3, atol=1e-12)


def test_dijkstra_is_never_shorter_than_exact():
    V, F = icosphere(3)
    sources = np.arange(0, len(V), 50)
    exact = ExactSolver(V, F).distances(sources)
    along_edges = DijkstraSolver(V, F).distances(sources)
    assert np.all(along_edges >= exact - 1e-9)


def test_dijkstra_keeps_the_triangle_inequality():
    V, F = icosphere(2)
    D = DijkstraSolver(V, F).distances(np.arange(len(V)))
    np.testing.assert_allclose(D, D.T, atol=1e-12)
    assert np.all(D[:, None, :] <= D[:, :, None] + D[None, :, :] + 1e-12)


def test_dijkstra_counts_edges_without_length():
    V = np.array([[0.0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 1, 0]])
    D = DijkstraSolver(V, [[0, 1, 2], [1, 3, 2]]).distances([0])
    np.testing.assert_allclose(D[0, :3], [0.0, 0.0, 1.0])


def test_heat_converges_as_the_mesh_is_refined():
    errors = []
    for level in (2, 3, 4):
        V, F = icosphere(level)
        truth = np.arccos(np.clip(V @ V[0], -1.0, 1.0))
        errors.append(np.abs(HeatSolver(V, F).distances([0])[0] - truth).mean())
    assert errors[2] < 0.6 * errors[1] < 0.36 * errors[0]


def test_heat_strays_from_the_exact_distance_with_more_time():
    V, F = torus(48, 24)
    truth = ExactSolver(V, F).distances([0])[0]
    errors = [
        np.abs(HeatSolver(V, F, t_coef=t).distances([0])[0] - truth).mean() for t in (1, 10, 100)
    ]
    assert errors[0] < errors[1] < errors[2]
    assert errors[2] > 2.0 * errors[0]


def test_heat_crosses_edges_and_vertices_that_are_not_manifold():
    V, F = plane(9)
    fin = np.array([[0.5, 0.5, 1.0]])
    fold = F[0][[0, 1]]
    points = np.concatenate([V, fin])
    faces = np.concatenate([F, [[fold[0], fold[1], 81]]])
    D = HeatSolver(points, faces).distances([40])[0]
    assert np.all(np.isfinite(D))
    assert D[81] == pytest.approx(
        np.linalg.norm(V[40] - V[0]) + np.linalg.norm(fin - V[0]), rel=0.3
    )


def test_exact_refuses_an_edge_with_three_faces():
    V = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]])
    with pytest.raises(InputError, match="edge of vertices 0 and 1 has 3 faces"):
        ExactSolver(V, [[0, 1, 2], [1, 0, 3], [0, 1, 4]])


def test_exact_refuses_two_fans_at_one_vertex():
    V = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    with pytest.raises(InputError, match="meet at vertex 0"):
        ExactSolver(V, [[0, 1, 2], [0, 3, 4]])


@pytest.mark.parametrize(
    "mesh", [plane(6), icosphere(1), cylinder(8, 4), side_by_side(plane(3), plane(3))]
)
def test_exact_accepts_manifolds_with_and_without_borders(mesh):
    assert ExactSolver(*mesh).distances([0]).shape == (1, len(mesh[0]))


def test_heat_says_that_a_mesh_shrunk_to_a_point_cannot_be_solved():
    _, F = plane(3)
    with pytest.raises(CapacityError, match="heat method cannot"):
        HeatSolver(np.zeros((9, 3)), F).distances([0])


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(
    ("V", "F", "message"),
    [
        (np.zeros((3, 2)), [[0, 1, 2]], r"shape \(N, 3\)"),
        (np.zeros((4, 3)), [[0, 1, 2, 3]], "triangulate"),
        (np.zeros((3, 3)), [[0, 1, 3]], "index 3 is out of range"),
        (np.zeros((3, 3)), [[0, -1, 2]], "index -1 is out of range"),
        (np.full((3, 3), np.nan), [[0, 1, 2]], "point 0 is not finite"),
        (np.zeros((3, 3)), np.zeros((0, 3), dtype=int), "no faces"),
        (np.zeros((3, 3)), [[0.0, 1.0, 2.0]], "must be integers"),
        (np.zeros((3, 3), dtype=complex), [[0, 1, 2]], "real numbers"),
    ],
)
def test_refuses_what_is_no_mesh(solver, V, F, message):
    with pytest.raises(InputError, match=message):
        solver(V, F)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(
    ("sources", "message"),
    [
        ([9], "9 is out of range"),
        ([-1], "-1 is out of range"),
        ([0.5], "list of vertex"),
        (1, "list"),
    ],
)
def test_refuses_what_is_no_source(solver, sources, message):
    with pytest.raises(UsageError, match=message):
        solver(*plane(3)).distances(sources)


@pytest.mark.parametrize("name", sorted(RECORDS))
def test_a_record_builds_by_its_defaults_and_names_what_it_does_not_take(name):
    record = RECORDS[name]
    V, F = plane(4)
    by_default = record.factory(V, F).distances([0])
    np.testing.assert_array_equal(
        record.factory(V, F, **record.parameters).distances([0]), by_default
    )
    with pytest.raises(UsageError, match="'speed'"):
        record.factory(V, F, speed=9)


@pytest.mark.parametrize(
    "parameters", [{"t_coef": 0.0}, {"t_coef": "1"}, {"t_coef": np.nan}, {"use_robust": 2}]
)
def test_heat_names_the_parameter_it_refuses(parameters):
    with pytest.raises(UsageError, match=next(iter(parameters))):
        HeatSolver(*plane(3), **parameters)


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.02))
def test_distances_change_little_when_points_do(seed, amplitude):
    V, F = icosphere(2)
    noise = np.random.default_rng(seed).uniform(-amplitude, amplitude, V.shape)
    before = HeatSolver(V, F).distances([0])[0]
    after = HeatSolver(V + noise, F).distances([0])[0]
    assert np.abs(after - before).max() <= 0.02 + 10.0 * amplitude
