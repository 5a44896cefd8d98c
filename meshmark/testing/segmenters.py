"""What every segmenter must do; subclass `SegmenterSuite` in your own tests to check yours.

class TestMySegmenter(SegmenterSuite):
    @pytest.fixture
    def segmenter(self):
        return MySegmenter()
"""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from meshmark.arrays import FloatArray, IntArray
from meshmark.extension.interfaces import Segmenter
from meshmark.mesh.topology import face_components
from meshmark.testing.invariance import moved, reordered
from meshmark.testing.meshes import Mesh, dumbbell, icosphere, plane, side_by_side


def lopsided() -> Mesh:
    """Build a closed dumbbell of some 2300 vertices without any symmetry."""
    V, F = dumbbell(n_around=32, n_along=72)
    x, y, z = V.T
    V = np.stack([x + 0.05 * z**2, y * (1.0 + 0.04 * z), z + 0.1 * x * y], axis=1)
    return V * (1.0 + 0.05 * V[:, 2:]), F


def area_of(V: FloatArray, F: IntArray) -> FloatArray:
    """Compute the area of each face, (F,)."""
    cross = np.cross(V[F[:, 1]] - V[F[:, 0]], V[F[:, 2]] - V[F[:, 0]])
    return np.linalg.norm(cross, axis=1) / 2.0


def agreement(one: IntArray, two: IntArray, area: FloatArray) -> float:
    """Share of the area on which two labellings agree, parts matched as well as they can be.

    Parameters
    ----------
    one, two : (F,) int
        Labels of the same faces; part numbers need not be the same.
    area : (F,) float64
        Weight of each face.
    """
    overlap = np.zeros((int(one.max()) + 1, int(two.max()) + 1))
    np.add.at(overlap, (one, two), area)
    matched = linear_sum_assignment(-overlap)
    return float(overlap[matched].sum() / area.sum())


class SegmenterSuite:
    """Checks the contract of one segmenter; override `segmenter`, and what else differs."""

    @pytest.fixture
    def segmenter(self) -> Segmenter:
        """Offer the segmenter under test."""
        raise NotImplementedError("override the fixture `segmenter`")

    @pytest.fixture
    def mesh(self) -> Mesh:
        """Offer a closed mesh the segmenter should cut, without symmetry."""
        return lopsided()

    @pytest.fixture
    def least_agreement(self) -> float:
        """Share of the area on which labels must agree where only rounding differs."""
        return 1.0 - 1e-9

    def test_has_the_interface(self, segmenter: Segmenter) -> None:
        """It offers `segment`."""
        assert isinstance(segmenter, Segmenter)

    def test_labels_each_face_once(self, segmenter: Segmenter, mesh: Mesh) -> None:
        """Labels are integers, one a face, and none between 0 and the largest is missing."""
        V, F = mesh
        labels = segmenter.segment(V, F)
        assert isinstance(labels, np.ndarray)
        assert labels.shape == (len(F),)
        assert labels.dtype.kind in "iu"
        np.testing.assert_array_equal(np.unique(labels), np.arange(labels.max() + 1))

    def test_leaves_the_mesh_alone(self, segmenter: Segmenter, mesh: Mesh) -> None:
        """Segmenting never writes into the arrays it is given."""
        V, F = mesh
        before = V.copy(), F.copy()
        segmenter.segment(V, F)
        np.testing.assert_array_equal(V, before[0])
        np.testing.assert_array_equal(F, before[1])

    def test_same_mesh_same_labels(self, segmenter: Segmenter, mesh: Mesh) -> None:
        """Nothing is drawn by chance, and nothing is kept from one call to the next."""
        first = segmenter.segment(*mesh)
        segmenter.segment(*plane(5))
        np.testing.assert_array_equal(segmenter.segment(*mesh), first)

    def test_pickles(self, segmenter: Segmenter, mesh: Mesh) -> None:
        """A worker process gets the same labels."""
        copy = pickle.loads(pickle.dumps(segmenter))
        np.testing.assert_array_equal(copy.segment(*mesh), segmenter.segment(*mesh))

    def test_parts_are_edge_connected(self, segmenter: Segmenter, mesh: Mesh) -> None:
        """Each label is one connected region."""
        _, F = mesh
        labels = segmenter.segment(*mesh)
        assert face_components(F, labels).max() == labels.max()

    def test_components_do_not_share_parts(self, segmenter: Segmenter, mesh: Mesh) -> None:
        """Neither do two bodies that stand apart."""
        _, F = mesh
        ball, G = icosphere(3, radius=0.6)
        both, faces = side_by_side(mesh, (ball + np.array([9.0, 0.0, 0.0]), G))
        labels = segmenter.segment(both, faces)
        assert not np.intersect1d(labels[: len(F)], labels[len(F) :]).size
        assert face_components(faces, labels).max() == labels.max()

    @pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
    @pytest.mark.parametrize("seed", [1, 2])
    def test_similarity_changes_nothing(
        self,
        segmenter: Segmenter,
        mesh: Mesh,
        least_agreement: float,
        scale: float,
        seed: int,
    ) -> None:
        """Turning, scaling and shifting leave the parts, and their numbers, as they are."""
        V, F = mesh
        labels = segmenter.segment(V, F)
        again = segmenter.segment(moved(V, scale, np.random.default_rng(seed)), F)
        area = area_of(V, F)
        assert area[labels == again].sum() >= least_agreement * area.sum()

    @pytest.mark.parametrize("seed", [1, 2])
    def test_order_changes_nothing(
        self, segmenter: Segmenter, mesh: Mesh, least_agreement: float, seed: int
    ) -> None:
        """Labels go with their faces, wherever those stand and whatever corner comes first."""
        V, F = mesh
        labels = segmenter.segment(V, F)
        other = reordered(V, F, np.random.default_rng(seed))
        again = segmenter.segment(other.V, other.F)
        area = area_of(V, F)[other.face]
        assert area[labels[other.face] == again].sum() >= least_agreement * area.sum()

    def test_survives_faces_without_area(self, segmenter: Segmenter, mesh: Mesh) -> None:
        """Collapsed edges and repeated corners do no harm."""
        V, F = mesh
        squashed = V.copy()
        collapsed = F[:: len(F) // 20]
        squashed[collapsed[:, 1]] = squashed[collapsed[:, 0]]
        faces = np.concatenate([F, np.stack([F[:9, 0], F[:9, 0], F[:9, 1]], axis=1)])
        labels = segmenter.segment(squashed, faces)
        assert labels.shape == (len(faces),)
        assert face_components(faces, labels).max() == labels.max()

    def test_survives_coarse_coordinates(self, segmenter: Segmenter, mesh: Mesh) -> None:
        """Rounding to 64 steps makes slivers, folds and flat faces; parts stay connected."""
        V, F = mesh
        step = np.ptp(V, axis=0).max() / 64.0
        labels = segmenter.segment(np.round(V / step) * step, F)
        assert labels.shape == (len(F),)
        assert face_components(F, labels).max() == labels.max()

    def test_ignores_unused_vertices(self, segmenter: Segmenter, mesh: Mesh) -> None:
        """A vertex no face refers to changes nothing, however far away it is."""
        V, F = mesh
        stray = np.concatenate([V, [[1e3, 0.0, 0.0], [0.0, 0.0, 0.0]]])
        np.testing.assert_array_equal(segmenter.segment(stray, F), segmenter.segment(V, F))

    @pytest.mark.parametrize("n", [2, 12])
    def test_labels_an_open_surface(self, segmenter: Segmenter, n: int) -> None:
        """A flat sheet, down to two triangles, has at least one part and no volume to measure."""
        V, F = plane(n)
        labels = segmenter.segment(V, F)
        assert labels.shape == (len(F),)
        assert face_components(F, labels).max() == labels.max()

    def test_labels_a_single_triangle(self, segmenter: Segmenter) -> None:
        """The smallest mesh is one part."""
        V = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
        np.testing.assert_array_equal(segmenter.segment(V, np.array([[0, 1, 2]])), [0])
