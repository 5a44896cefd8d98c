"""Distances on proxies: those that are known in closed form, and those of the surface itself."""

from __future__ import annotations

import pickle
import sys

import numpy as np
import pytest

from meshmark import kernels
from meshmark.detection.extraction import Extraction
from meshmark.detection.observer import Observer, Reference
from meshmark.errors import CapacityError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.geometry import face_areas
from meshmark.mesh.proxy import build_proxy
from meshmark.mesh.smoothing import polygon_umbrella, smooth
from meshmark.mesh.topology import Topology
from meshmark.testing.meshes import bent_tube, bumpy_sphere, icosphere, plane, torus
from meshmark_plugins.schemes.apex.anchors import proxies
from meshmark_plugins.schemes.apex.anchors.components import large_components
from meshmark_plugins.schemes.apex.anchors.geodesics import GeodesicDistances
from meshmark_plugins.schemes.apex.anchors.proxies import MarkingProxies
from meshmark_plugins.schemes.apex.anchors.proxy_distances import ProxyDistances
from meshmark_plugins.schemes.apex.scheme import Apex

# Width of a bin, in root areas.
BIN = 0.04
# Radius of a sphere of area 1.
UNIT = 1.0 / np.sqrt(4.0 * np.pi)
HORNS = np.array([[1, 0.2, 0.1], [-0.3, 1, 0.2], [-0.6, -0.7, 0.5], [0.2, -0.5, -1]])


def measured(V, F, n_samples, pose=None):
    """Distances of a pose on a proxy that was built in another."""
    proxy = build_proxy(V, F, n_samples)
    return ProxyDistances(V if pose is None else pose, F, proxy)


def off(found, wanted):
    """How far distances are off, in bins: in 19 of 20 places, and at most."""
    gap = np.abs(found - wanted) / BIN
    return np.quantile(gap, 0.95), gap.max()


@pytest.mark.parametrize(
    ("level", "n_samples", "limit"),
    [
        (5, 4_000, (0.17, 0.4)),
        pytest.param(6, 12_000, (0.05, 0.25), marks=pytest.mark.slow),
        pytest.param(7, 12_000, (0.06, 0.25), marks=pytest.mark.slow),
        pytest.param(8, 12_000, (0.06, 0.25), marks=pytest.mark.slow),
    ],
)
def test_distances_on_a_sphere_are_arcs(level, n_samples, limit):
    V, F = icosphere(level, radius=5.0)
    sources = np.array([0, 500, 7000])
    arcs = np.arccos(np.clip(V[sources] @ V.T / 25.0, -1.0, 1.0)) * UNIT
    usual, most = off(measured(V, F, n_samples).from_vertices(sources), arcs)
    assert usual < limit[0]
    assert most < limit[1]


def test_distances_on_a_torus_are_those_of_the_torus_itself():
    V, F = torus(100, 40)
    sources = np.array([0, 20, 3000])
    found = measured(V, F, 2_000).from_vertices(sources)
    usual, most = off(found, GeodesicDistances(V, F).from_vertices(sources))
    assert usual < 0.25
    assert most < 0.6


def test_distances_stay_as_a_tube_bends():
    V, F = bent_tube(40, 100, angle=0.0)
    bent, _ = bent_tube(40, 100, angle=np.pi / 2)
    end = np.array([len(V) - 1])
    straight = measured(V, F, 2_000).from_vertices(end)
    usual, _ = off(measured(V, F, 2_000, pose=bent).from_vertices(end), straight)
    own, _ = off(GeodesicDistances(bent, F).from_vertices(end), straight)
    assert usual < own + 0.1
    # From the middle of one flat end to the far rim: a radius, and the length.
    rim = straight[0, :40] * np.sqrt(2.0 * np.pi * 0.3 * (4.0 + 0.3))
    np.testing.assert_allclose(rim, 4.3, rtol=0.01)


def test_a_cut_bends_distances_no_more_than_on_the_surface_itself():
    V, F = plane(60)
    source = np.array([30 * 60 + 3])
    usual, most = off(
        measured(V, F, 2_000).from_vertices(source), GeodesicDistances(V, F).from_vertices(source)
    )
    assert usual < 0.3
    assert most < 0.6


def test_ways_begin_at_the_source_as_they_do_on_the_mesh_itself():
    # Near the tip of a horn, which the proxy makes blunt.
    V, F = bumpy_sphere(5, HORNS, width=0.15)
    tips = np.array([np.argmax(V @ horn) for horn in HORNS])
    found = measured(V, F, 2_500).from_vertices(tips)
    wanted = GeodesicDistances(V, F).from_vertices(tips)
    ring = (wanted > BIN) & (wanted < 5.0 * BIN)
    gaps = [(f - w)[r].mean() / BIN for f, w, r in zip(found, wanted, ring, strict=True)]
    assert np.abs(gaps).max() < 0.08


def test_another_pose_tells_how_much_too_long_ways_are_near_a_source():
    V, F = bumpy_sphere(5, HORNS, width=0.15)
    x, y, z = V.T
    turn = 0.3 * z
    turned = np.stack(
        [np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y, z], axis=1
    )
    tips = np.array([np.argmax(V @ horn) for horn in HORNS])
    proxy = build_proxy(V, F, 2_500)
    reference = ProxyDistances(V, F, proxy)
    own = ProxyDistances(turned, F, proxy).to_proxy(tips)
    told = ProxyDistances(turned, F, proxy, surpluses=reference.surpluses).to_proxy(tips)
    assert np.abs(told - own).max() < 0.05 * BIN
    assert np.abs(reference.surpluses(tips)).max() > 0.05 * BIN


def test_surpluses_are_measured_once_and_known_to_workers(monkeypatch):
    monkeypatch.setattr(proxies, "MOST_VERTICES", 600)
    monkeypatch.setattr(proxies, "MARKING_PROXY_VERTICES", 600)
    V, F = bumpy_sphere(4, HORNS, width=0.15)
    [component] = large_components(V, F)
    tips = np.array([np.argmax(V @ horn) for horn in HORNS])
    marking = MarkingProxies(V, F)
    wanted = marking.distances(V, component).to_proxy(tips)
    # However many are asked for, and in whatever order.
    one_by_one = [marking.distances(V, component).to_proxy(tips[[i]])[0] for i in range(len(tips))]
    np.testing.assert_array_equal(one_by_one, wanted)
    backwards = MarkingProxies(V, F).distances(V, component).to_proxy(tips[::-1])
    np.testing.assert_array_equal(backwards[::-1], wanted)
    sent = pickle.loads(pickle.dumps(marking))
    monkeypatch.setattr(ProxyDistances, "surpluses", None)
    np.testing.assert_array_equal(sent.distances(V, component).to_proxy(tips), wanted)


def test_a_pose_without_area_has_no_distances():
    V, F = plane(40)
    with pytest.raises(CapacityError, match="no area"):
        measured(V, F, 600, pose=V * [1, 0, 0])


@pytest.mark.parametrize(
    ("level", "n_samples", "least"),
    [(4, 1_800, 0.85), pytest.param(6, 12_000, 0.9, marks=pytest.mark.slow)],
)
def test_a_frame_reads_the_same_by_a_proxy(monkeypatch, level, n_samples, least):
    V, F = bumpy_sphere(level, HORNS)
    monkeypatch.setattr(proxies, "MOST_VERTICES", len(V))
    frame = Frame(0.0, V, Topology.from_triangles(F, len(V)))
    itself = Apex().observe(frame)
    monkeypatch.setattr(proxies, "MOST_VERTICES", n_samples)
    monkeypatch.setattr(proxies, "PROXY_VERTICES", n_samples)
    by_proxy = Apex().observe(frame)
    gaps = np.linalg.norm(V[by_proxy.vertices][:, None] - V[itself.vertices], axis=2)
    order = gaps.argmin(axis=1)
    assert sorted(order) == [0, 1, 2, 3]
    # A fiftieth of a root area: half a bin.
    assert gaps.min(axis=1).max() < 0.02 * np.sqrt(face_areas(V, F).sum())
    np.testing.assert_allclose(by_proxy.descriptors, itself.descriptors[order], rtol=0.02)
    own, other = (each.soft[0] for each in (itself, by_proxy))
    assert np.corrcoef(own[order].ravel(), other.ravel())[0, 1] > least
    # And a reference in the same pose makes no difference.
    again = Apex().observe(frame, frame)
    np.testing.assert_array_equal(again.soft, by_proxy.soft)


def test_parts_too_thin_for_a_proxy_are_measured_as_they_are(monkeypatch):
    monkeypatch.setattr(proxies, "MOST_VERTICES", 300)
    monkeypatch.setattr(proxies, "build_proxy", lambda *_: None)
    V, F = bumpy_sphere(3, HORNS)
    frame = Frame(0.0, V, Topology.from_triangles(F, len(V)))
    found = Apex().observe(frame)
    monkeypatch.setattr(proxies, "MOST_VERTICES", 10_000)
    np.testing.assert_array_equal(found.soft, Apex().observe(frame).soft)


@pytest.mark.parametrize(("smoothed", "thin", "n_built"), [(50, 0, 4), (50, 1, 4), (0, 0, 1)])
def test_a_proxy_serves_all_looks_and_frames(monkeypatch, smoothed, thin, n_built):
    built = []

    def counted(X, F, n_samples):
        built.append(X)
        return None if thin and len(built) > 1 else build_proxy(X, F, n_samples)

    monkeypatch.setattr(proxies, "MOST_VERTICES", 600)
    monkeypatch.setattr(proxies, "PROXY_VERTICES", 600)
    monkeypatch.setattr(proxies, "build_proxy", counted)
    V, F = bumpy_sphere(3, HORNS)
    V = V + (0.0 if smoothed else 0.03) * np.random.default_rng(1).normal(size=V.shape)
    V = smooth(V, polygon_umbrella(Topology.from_triangles(F, len(V))), smoothed)
    animation = MeshAnimation.from_arrays(np.stack([V, V * [1.0, 1.1, 1.0]]), F)
    view = Extraction(animation, Apex(), "apex")
    view.look([0], (0,))
    assert [variant.restored for variant in view.look([0, 1]).variants] == [0, 10, 30, 50]
    # What is restored has one of its own, unless that is too rough, or too thin.
    assert len(built) == n_built


def test_looking_at_a_copy_takes_no_compiled_loops(monkeypatch):
    monkeypatch.setattr(proxies, "MOST_VERTICES", 600)
    monkeypatch.setattr(proxies, "PROXY_VERTICES", 600)
    # They take longer to load than they would save.
    # As in a process that has not needed them.
    monkeypatch.delitem(sys.modules, "numba", raising=False)
    monkeypatch.setattr(kernels, "load_loops", lambda name: pytest.fail(f"loads {name}"))
    V, F = bumpy_sphere(3, HORNS)
    frame = Frame(0.0, V, Topology.from_triangles(F, len(V)))
    assert len(Apex().observe(frame).vertices) == 4


def test_it_makes_no_difference_which_restoration_is_measured_first(monkeypatch):
    monkeypatch.setattr(proxies, "MOST_VERTICES", 600)
    monkeypatch.setattr(proxies, "PROXY_VERTICES", 600)
    V, F = bumpy_sphere(3, HORNS)
    animation = MeshAnimation.from_arrays(np.stack([V, V * [1.0, 1.1, 1.0]]), F)
    backwards, forwards = (
        Observer(Reference(animation, 0), Apex(), counts)(1) for counts in ((50, 0), (0, 50))
    )
    for one, two in zip(backwards, reversed(forwards), strict=True):
        np.testing.assert_array_equal(one.soft, two.soft)
