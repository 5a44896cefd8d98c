"""What every geodesic solver must do; subclass `GeodesicSolverSuite` to check yours.

class TestMySolver(GeodesicSolverSuite):
    @pytest.fixture
    def solver_factory(self):
        return MySolver
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from meshmark.arrays import FloatArray, IntArray
from meshmark.extension.interfaces import GeodesicSolver
from meshmark.testing.invariance import moved, reordered
from meshmark.testing.meshes import Mesh, bent_tube, icosphere, plane, side_by_side, torus

SolverFactory = Callable[[FloatArray, IntArray], GeodesicSolver]


class GeodesicSolverSuite:
    """Checks the contract of one solver; override `solver_factory`, and the tolerances."""

    @pytest.fixture
    def solver_factory(self) -> SolverFactory:
        """Offer a function from V (N, 3) and F (F, 3) to a solver."""
        raise NotImplementedError("override the fixture `solver_factory`")

    @pytest.fixture
    def relative_error(self) -> float:
        """Mean error allowed, as a share of the mean distance."""
        return 0.03

    @pytest.fixture
    def repeatability(self) -> float:
        """Difference allowed where only rounding differs, as a share of the largest distance."""
        return 1e-6

    @pytest.fixture
    def mesh(self) -> Mesh:
        """Offer a connected mesh without symmetry."""
        V, F = bent_tube(24, 60, angle=2.0)
        x, y, z = V.T
        return np.stack([x + 0.1 * y * z, y * (1.0 + 0.1 * z), z + 0.05 * x**2], axis=1), F

    def test_has_the_interface(self, solver_factory: SolverFactory, mesh: Mesh) -> None:
        """What is built offers `distances`."""
        assert isinstance(solver_factory(*mesh), GeodesicSolver)

    def test_answers_one_row_a_source(self, solver_factory: SolverFactory, mesh: Mesh) -> None:
        """Rows come in the order of the sources, however they are asked for."""
        V, F = mesh
        solver = solver_factory(V, F)
        sources = np.array([7, 3, 7, len(V) - 1])
        D = solver.distances(sources)
        assert D.shape == (4, len(V))
        assert D.dtype == np.float64
        for source, row in zip(sources, D, strict=True):
            np.testing.assert_array_equal(solver.distances(np.array([source]))[0], row)
        assert solver.distances(np.array([], dtype=np.int64)).shape == (0, len(V))

    def test_a_distance_is_zero_at_its_source_alone(
        self, solver_factory: SolverFactory, mesh: Mesh
    ) -> None:
        """A connected mesh has a finite distance everywhere, positive off the source."""
        V, F = mesh
        sources = np.arange(0, len(V), len(V) // 8)
        D = solver_factory(V, F).distances(sources)
        assert np.all(np.isfinite(D))
        np.testing.assert_array_equal(D[np.arange(len(sources)), sources], 0.0)
        assert np.sum(D <= 0.0) == len(sources)

    def test_leaves_the_mesh_alone(self, solver_factory: SolverFactory, mesh: Mesh) -> None:
        """Solving never writes into the arrays it is given."""
        V, F = mesh
        before = V.copy(), F.copy()
        solver_factory(V, F).distances(np.array([0]))
        np.testing.assert_array_equal(V, before[0])
        np.testing.assert_array_equal(F, before[1])

    def test_same_mesh_same_distances(self, solver_factory: SolverFactory, mesh: Mesh) -> None:
        """Two solvers on one mesh agree to the last bit."""
        sources = np.array([0, 11])
        np.testing.assert_array_equal(
            solver_factory(*mesh).distances(sources), solver_factory(*mesh).distances(sources)
        )

    def test_plane(self, solver_factory: SolverFactory, relative_error: float) -> None:
        """On a flat square it is the straight line."""
        V, F = plane(25)
        source = 12 * 25 + 12
        D = solver_factory(V, F).distances(np.array([source]))[0]
        assert_close(D, np.linalg.norm(V - V[source], axis=1), relative_error)

    def test_sphere(self, solver_factory: SolverFactory, relative_error: float) -> None:
        """On a sphere it is the great circle."""
        V, F = icosphere(4, radius=2.0)
        D = solver_factory(V, F).distances(np.array([5]))[0]
        angle = np.arccos(np.clip(V @ V[5] / 4.0, -1.0, 1.0))
        assert_close(D, 2.0 * angle, relative_error)

    def test_torus(self, solver_factory: SolverFactory, relative_error: float) -> None:
        """Along the inner equator of a torus it is an arc: every way around it is longer."""
        n, minor = 96, 0.4
        V, F = torus(n, 48, 1.0, minor)
        inner = np.arange(n) * 48 + 24
        D = solver_factory(V, F).distances(inner[:1])[0, inner]
        steps = np.minimum(np.arange(n), n - np.arange(n))
        assert_close(D, (1.0 - minor) * 2.0 * np.pi / n * steps, relative_error)

    def test_there_is_as_far_as_back(
        self, solver_factory: SolverFactory, mesh: Mesh, relative_error: float
    ) -> None:
        """Distances are symmetric."""
        sources = np.arange(0, len(mesh[0]), len(mesh[0]) // 12)
        D = solver_factory(*mesh).distances(sources)[:, sources]
        assert np.abs(D - D.T).mean() <= relative_error * D.mean()

    @pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
    def test_similarity_scales_distances(
        self, solver_factory: SolverFactory, mesh: Mesh, repeatability: float, scale: float
    ) -> None:
        """Turning and shifting change nothing, scaling scales."""
        V, F = mesh
        sources = np.array([0, len(V) // 2])
        D = solver_factory(V, F).distances(sources)
        M = solver_factory(moved(V, scale, np.random.default_rng(3)), F).distances(sources)
        assert np.abs(M / scale - D).max() <= repeatability * D.max()

    def test_order_changes_nothing(
        self, solver_factory: SolverFactory, mesh: Mesh, repeatability: float
    ) -> None:
        """Distances go with their vertices, wherever those stand."""
        V, F = mesh
        other = reordered(V, F, np.random.default_rng(4))
        D = solver_factory(V, F).distances(other.vertex[[0, 9]])
        M = solver_factory(other.V, other.F).distances(np.array([0, 9]))
        assert np.abs(M - D[:, other.vertex]).max() <= repeatability * D.max()

    def test_other_components_are_out_of_reach(
        self, solver_factory: SolverFactory, mesh: Mesh, repeatability: float
    ) -> None:
        """Inf there, and here what it is without them; so for vertices of no face."""
        V, F = mesh
        ball, G = icosphere(2)
        both, faces = side_by_side((V, F), (ball + 5.0, G), (np.full((1, 3), 9.0), F[:0]))
        n, m = len(V), len(V) + len(ball)
        D = solver_factory(both, faces).distances(np.array([1, n + 1, m]))
        alone = solver_factory(V, F).distances(np.array([1]))[0]
        assert np.abs(D[0, :n] - alone).max() <= repeatability * alone.max()
        assert np.all(np.isinf(D[0, n:]))
        assert np.all(np.isfinite(D[1, n:m]))
        assert np.all(np.isinf(D[1, :n]))
        np.testing.assert_array_equal(D[2], np.where(np.arange(m + 1) == m, 0.0, np.inf))

    def test_survives_faces_without_area(
        self, solver_factory: SolverFactory, mesh: Mesh, relative_error: float
    ) -> None:
        """Slivers, flat faces and repeated corners do no harm where the surface is sound."""
        V, F = mesh
        sources = np.array([0, 40])
        D = solver_factory(V, F).distances(sources)
        # Splitting a face at the middle of an edge makes a face without area beside two halves.
        a, b, c = F[0]
        middle = len(V)
        points = np.concatenate([V, [(V[a] + V[b]) / 2.0]])
        halves = np.array([[a, middle, c], [middle, b, c], [a, b, middle], [a, a, b]])
        M = solver_factory(points, np.concatenate([F[1:], halves])).distances(sources)
        assert np.all(np.isfinite(M))
        assert np.abs(M[:, : len(V)] - D).mean() <= relative_error * D.mean()


def assert_close(D: FloatArray, truth: FloatArray, relative_error: float) -> None:
    """Fail unless the mean error is within a share of the mean distance, and none is wild."""
    error = np.abs(D - truth)
    assert error.mean() <= relative_error * truth.mean()
    assert error.max() <= 3.0 * relative_error * truth.max()
