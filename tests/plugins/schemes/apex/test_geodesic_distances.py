"""Heat-method distances of surfaces where they are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.errors import CapacityError
from meshmark.testing.invariance import moved
from meshmark.testing.meshes import icosphere, plane, torus
from meshmark_plugins.geodesics.heat import HeatSolver
from meshmark_plugins.schemes.apex.anchors.geodesics import GeodesicDistances

# Radius of a sphere of area 1.
UNIT = 1.0 / np.sqrt(4.0 * np.pi)


def test_distances_on_a_sphere_are_arcs_in_units_of_its_root_area():
    V, F = icosphere(5, radius=7.0)
    geodesics = GeodesicDistances(V, F)
    assert geodesics.root_area == pytest.approx(7.0 / UNIT, rel=1e-3)
    poles = np.array([0, 11, 500])
    arcs = np.arccos(np.clip(V[poles] @ V.T / 49.0, -1.0, 1.0)) * UNIT
    # A third of a per cent of the way to the other pole.
    np.testing.assert_allclose(geodesics.from_vertices(poles), arcs, atol=0.0035 * np.pi * UNIT)
    np.testing.assert_array_equal(geodesics.from_vertices(poles)[1], geodesics.from_vertex(11))


def test_distances_hardly_depend_on_how_finely_the_surface_is_meshed():
    coarse, fine = torus(60, 30), torus(120, 60)
    shared = np.arange(120 * 60).reshape(120, 60)[::2, ::2].ravel()
    np.testing.assert_array_equal(fine[0][shared], coarse[0])
    change = (
        GeodesicDistances(*coarse).from_vertex(5)
        - GeodesicDistances(*fine).from_vertex(shared[5])[shared]
    )
    assert np.abs(change).max() < 0.005
    # With a mean edge for the diffusion length, they do.
    usual = HeatSolver(*coarse).distances([5]) - HeatSolver(*fine).distances([shared[5]])[:, shared]
    assert np.abs(usual).max() / GeodesicDistances(*coarse).root_area > 0.02


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_distances_do_not_depend_on_place_or_size(scale):
    V, F = torus(40, 20)
    other = GeodesicDistances(moved(V, scale, np.random.default_rng(1)), F)
    own = GeodesicDistances(V, F)
    assert other.root_area == pytest.approx(scale * own.root_area, rel=1e-12)
    np.testing.assert_allclose(other.from_vertex(3), own.from_vertex(3), rtol=0, atol=1e-9)


def test_a_surface_without_area_has_no_unit_of_distance():
    V, F = plane(4)
    with pytest.raises(CapacityError, match="no area"):
        GeodesicDistances(V * [1, 0, 0], F)
