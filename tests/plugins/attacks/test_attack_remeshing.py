from __future__ import annotations

import sys

import numpy as np
import pytest

from meshmark.errors import InputError, PluginError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.topology import boundary_edges, edges
from meshmark.metrics import surface_distance
from meshmark.testing.attacks import AttackSuite, bending_ball, sphere
from meshmark_plugins.attacks import RECORDS
from meshmark_plugins.attacks.remeshing_sdf import marching_cubes

BY_NAME = {record.name: record for record in RECORDS}


class TestRemeshingSdf(AttackSuite):
    @pytest.fixture
    def record(self):
        return BY_NAME["remeshing-sdf"]

    @pytest.fixture
    def parameters(self):
        return {"resolution": 24}


class TestRemeshingSdfOfEachFrame(TestRemeshingSdf):
    @pytest.fixture
    def parameters(self):
        return {"resolution": 16, "per": "frame"}

    @pytest.fixture
    def animation(self):
        return bending_ball(3)


class TestRemeshingIsotropic(AttackSuite):
    @pytest.fixture
    def record(self):
        pytest.importorskip("gpytoolbox", reason="gpytoolbox, an optional library, is absent")
        return BY_NAME["remeshing-isotropic"]

    @pytest.fixture
    def parameters(self):
        return {"iterations": 3}


def remeshed(name, animation, **parameters):
    return BY_NAME[name].factory(**parameters).apply(animation, np.random.default_rng(0))


def volume(V, F):
    a, b, c = (V[F[:, k]] for k in range(3))
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6


@pytest.mark.parametrize("offset", [0.0, 1000.0])
def test_marching_cubes_find_the_sphere_again(offset):
    V, F = sphere(3000)
    W, G = marching_cubes(2 * V + offset, F, 32)
    # Linear interpolation in cells of 1/16 errs by about the square of a cell's half diagonal.
    np.testing.assert_allclose(np.linalg.norm(W - offset, axis=1), 2.0, atol=5e-3)
    assert len(boundary_edges(G)) == 0
    assert volume(W - offset, G) == pytest.approx(4 / 3 * np.pi * 8, rel=0.01)


def test_two_bodies_stay_two_and_a_cavity_stays_hollow():
    V, F = sphere(1000)
    n = len(V)
    inside_out = F[:, ::-1]
    both = np.concatenate([V, 0.5 * V, 0.3 * V + [3, 0, 0]])
    faces = np.concatenate([F, inside_out + n, F + 2 * n])
    W, G = marching_cubes(both, faces, 64)
    ball = 4 / 3 * np.pi
    assert volume(W, G) == pytest.approx(ball * (1 - 0.5**3 + 0.3**3), rel=0.02)


def test_a_sheet_without_an_inside_is_refused():
    V = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    sheet = MeshAnimation.from_arrays(V, np.array([[0, 1, 2]]), prim="/P", origin="p.usda")
    with pytest.raises(InputError, match=r"p\.usda: /P: frame 1: .* 3 of 3 edges are borders"):
        remeshed("remeshing-sdf", sheet, resolution=8)


@pytest.mark.parametrize(
    ("name", "parameters"),
    [("remeshing-sdf", {"resolution": 32}), ("remeshing-isotropic", {"iterations": 3})],
)
def test_one_new_connectivity_follows_the_surface_through_all_frames(name, parameters):
    if name == "remeshing-isotropic":
        pytest.importorskip("gpytoolbox", reason="gpytoolbox, an optional library, is absent")
    ball = bending_ball()
    new = remeshed(name, ball, **parameters)
    assert new.constant_topology
    for before, after in zip(ball, new, strict=True):
        distance = surface_distance(before.points, before.faces, after.points, after.faces)
        assert distance.mrms < 0.01
        # Hardly any vertex is where one was.
        corners = before.points[:, None] - after.points[None, ::7]
        assert np.median(np.linalg.norm(corners, axis=2).min(axis=0)) > 0.005


def test_isotropic_edges_are_even():
    pytest.importorskip("gpytoolbox", reason="gpytoolbox, an optional library, is absent")
    V, F = sphere(1500)
    stretched = MeshAnimation.from_arrays(V * [1, 1, 4], F)
    new = remeshed("remeshing-isotropic", stretched, per="frame")[0]
    spread = []
    for frame in (stretched[0], new):
        E = edges(frame.faces)
        length = np.linalg.norm(frame.points[E[:, 0]] - frame.points[E[:, 1]], axis=1)
        spread.append(length.std() / length.mean())
    assert spread[1] < 0.6 * spread[0]
    assert len(boundary_edges(new.faces)) == 0


def test_a_missing_library_is_named_with_what_to_do(monkeypatch):
    monkeypatch.setitem(sys.modules, "gpytoolbox", None)
    with pytest.raises(PluginError, match="pip install gpytoolbox"):
        remeshed("remeshing-isotropic", bending_ball())
