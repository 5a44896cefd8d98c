"""The segmenter by shape diameter: the suite of every segmenter, and what it finds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshmark.errors import InputError, UsageError
from meshmark.mesh.topology import face_adjacency, face_components
from meshmark.testing.meshes import dumbbell, icosphere, revolution
from meshmark.testing.segmenters import SegmenterSuite, agreement, area_of, lopsided
from meshmark_plugins.segmenters import SDF_PARAMETERS, meshmark_segmenters
from meshmark_plugins.segmenters.sdf import SDFSegmenter, shape_diameter


class TestSDFSegmenter(SegmenterSuite):
    @pytest.fixture
    def segmenter(self):
        return meshmark_segmenters()[0].factory()


class TestThreeLevels(SegmenterSuite):
    @pytest.fixture
    def segmenter(self):
        return SDFSegmenter(clusters=3, covariance="full")


# All of it


def test_dumbbell_is_cut_at_the_ends_of_its_neck():
    V, F = dumbbell(neck=0.3, length=2.0)
    labels = SDFSegmenter().segment(V, F)
    assert labels.max() == 2
    pairs, shared = face_adjacency(F)
    loop = V[np.unique(shared[labels[pairs[:, 0]] != labels[pairs[:, 1]]])]
    # Within two edges of where neck and balls meet, and nowhere else.
    np.testing.assert_allclose(np.abs(loop[:, 2]), 1.0, atol=0.2)
    np.testing.assert_allclose(np.hypot(loop[:, 0], loop[:, 1]), 0.3, atol=0.12)


def test_smooth_bodies_of_one_thickness_are_one_part():
    for V, F in (icosphere(4), icosphere(3, radius=1e-4)):
        assert SDFSegmenter().segment(V, F).max() == 0


def test_three_levels_tell_three_thicknesses():
    # A rod that is turned down twice: radius 0.25, then 0.5, then 1.
    z = np.linspace(0.0, 12.0, 145)
    V, F = revolution(2.0 ** np.minimum(np.floor(z / 4.0) - 2.0, 0.0), z, 48)
    two, three = (SDFSegmenter(clusters=k).segment(V, F) for k in (2, 3))
    height = V[F].mean(axis=1)[:, 2]
    area = area_of(V, F)
    truth = np.minimum(np.floor(height / 4.0), 2.0).astype(np.int64)
    assert agreement(truth, three, area) > 0.9
    assert agreement(truth, two, area) < 0.9


def test_one_level_leaves_a_mesh_whole():
    assert SDFSegmenter(clusters=1).segment(*lopsided()).max() == 0


def test_price_decides_how_much_is_cut():
    V, F = lopsided()
    parts = [SDFSegmenter(smoothness=s).segment(V, F).max() + 1 for s in (0.1, 10.0)]
    assert parts == [3, 1]


@settings(max_examples=12)
@given(st.integers(0, 2**32 - 1), st.sampled_from([5e-4, 1e-3]))
def test_parts_survive_noise(seed, amplitude):
    V, F = lopsided()
    reach = np.linalg.norm(V - V.mean(axis=0), axis=1).mean()
    noise = np.random.default_rng(seed).uniform(-1.0, 1.0, V.shape) * amplitude * reach
    labels = SDFSegmenter().segment(V, F)
    assert agreement(labels, SDFSegmenter().segment(V + noise, F), area_of(V, F)) > 0.98


# What is refused


@pytest.mark.parametrize(
    ("parameter", "value"),
    [
        ("cone_angle", 0.0),
        ("cone_angle", 180.0),
        ("cone_angle", "wide"),
        ("rays", 0),
        ("rays", 2.5),
        ("clusters", 0),
        ("smoothness", -1.0),
        ("smoothness", True),
        ("smoothness", np.nan),
        ("min_area", 1.0),
        ("covariance", "diag"),
    ],
)
def test_names_the_parameter_it_refuses(parameter, value):
    with pytest.raises(UsageError, match=parameter):
        meshmark_segmenters()[0].factory(**{parameter: value})


def test_names_the_parameters_it_takes():
    with pytest.raises(UsageError, match=r"'beams'.*clusters.*smoothness"):
        meshmark_segmenters()[0].factory(beams=25)


def test_takes_the_least_price_and_the_least_area():
    V, F = lopsided()
    labels = SDFSegmenter(smoothness=0.0, min_area=0.0).segment(V, F)
    assert face_components(F, labels).max() == labels.max()


def test_record_lists_the_defaults():
    assert SDFSegmenter(**SDF_PARAMETERS) == SDFSegmenter()


@pytest.mark.parametrize(
    ("V", "F", "message"),
    [
        (np.zeros((3, 2)), [[0, 1, 2]], r"shape \(N, 3\)"),
        (np.zeros((3, 3)), np.zeros((0, 3), dtype=int), "no faces"),
        (np.full((3, 3), np.inf), [[0, 1, 2]], "not finite"),
        (np.zeros((3, 3)), [[0, 1, 7]], "7 is out of range"),
    ],
)
def test_refuses_what_is_no_mesh(V, F, message):
    with pytest.raises(InputError, match=message):
        SDFSegmenter().segment(V, F)
    with pytest.raises(InputError, match=message):
        shape_diameter(V, F)


def test_mesh_of_coincident_points_is_one_part():
    V, F = icosphere(1)
    np.testing.assert_array_equal(SDFSegmenter().segment(0.0 * V, F), 0)


# Real input


def gallop(data_folder: Path, name: str, prim: str, times: list[float]):
    """Points at some times (T, N, 3), and triangles, of an animation."""
    usd = pytest.importorskip("pxr.Usd")
    geom = pytest.importorskip("pxr.UsdGeom")
    path = data_folder / name
    if not path.is_file():
        pytest.skip(f"{name} is not among the reference assets")
    stage = usd.Stage.Open(str(path))
    mesh = geom.Mesh(stage.GetPrimAtPath(prim))
    points = np.array([np.asarray(mesh.GetPointsAttr().Get(t), dtype=float) for t in times])
    faces = np.asarray(mesh.GetFaceVertexIndicesAttr().Get(), dtype=np.int64).reshape(-1, 3)
    return points, faces


@pytest.fixture(scope="module")
def horse(data_folder):
    return gallop(data_folder, "horse-gallop.usdc", "/Horse/Geom/body", [1, 13, 25, 37])


def test_horse_has_the_same_seven_parts_in_every_pose(horse):
    points, F = horse
    labels = [SDFSegmenter().segment(V, F) for V in points]
    area = area_of(points[0], F)
    for other in labels:
        # Body, neck and head, tail, four legs.
        assert other.max() + 1 == 7
        assert agreement(labels[0], other, area) > 0.95


def test_horse_keeps_its_parts_when_it_is_rounded_and_shaken(horse):
    points, F = horse
    V, area = points[0], area_of(points[0], F)
    labels = SDFSegmenter().segment(V, F)
    step = np.ptp(V, axis=0) / 2**10
    reach = np.linalg.norm(V - V.mean(axis=0), axis=1).mean()
    noise = np.random.default_rng(0).uniform(-1.0, 1.0, V.shape) * 1e-3 * reach
    for attacked in (np.round(V / step) * step, V + noise):
        assert agreement(labels, SDFSegmenter().segment(attacked, F), area) > 0.985


# Frozen


def test_shares_of_the_lopsided_dumbbell():
    V, F = lopsided()
    share = np.bincount(SDFSegmenter().segment(V, F), weights=area_of(V, F))
    np.testing.assert_allclose(share / share.sum(), [0.5694, 0.3013, 0.1293], atol=2e-3)
