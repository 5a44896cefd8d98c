"""What is remembered of triangles: worked out once, as long as they are."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.mesh.remembered import read_only, remembered
from meshmark.mesh.topology import Topology, edges, face_components
from meshmark.testing.meshes import torus


@pytest.fixture
def counted():
    asked = []

    @remembered
    def total(array):
        asked.append(id(array))
        return int(array.sum())

    return total, asked


def test_of_what_cannot_change_it_is_worked_out_once(counted):
    total, asked = counted
    fixed = read_only(np.arange(6))
    assert [total(fixed), total(fixed)] == [15, 15]
    assert len(asked) == 1
    # Another array of the same values is another.
    total(read_only(np.arange(6)))
    assert len(asked) == 2


def test_of_what_may_change_nothing_is_remembered(counted):
    total, _ = counted
    changing = np.arange(6)
    assert total(changing) == 15
    changing[0] = 10
    assert total(changing) == 25


def test_nothing_outlives_its_array(counted):
    total, asked = counted
    for number in range(20):
        # A new array may well lie where the last one did.
        assert total(read_only(np.full(1000, number))) == 1000 * number
    assert len(asked) == 20


def test_triangles_of_a_topology_are_fixed_and_their_edges_remembered():
    V, F = torus(12, 8)
    topology = Topology.from_triangles(F, len(V))
    with pytest.raises(ValueError, match="read-only"):
        topology.triangles[0, 0] = 1
    assert edges(topology.triangles) is edges(topology.triangles)
    assert face_components(topology.triangles) is face_components(topology.triangles)
    assert edges(F) is not edges(F)
    np.testing.assert_array_equal(edges(F), edges(topology.triangles))
