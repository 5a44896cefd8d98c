"""Residual heights: what was laid on is measured, what honest programs do is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshmark.extension.informed import AlignedFrame
from meshmark.mesh.animation import Frame
from meshmark.mesh.geometry import surface_box, vertex_normals
from meshmark.mesh.smoothing import polygon_umbrella, smooth
from meshmark.mesh.subdivision import subdivide
from meshmark.mesh.topology import Topology
from meshmark.testing.informed_schemes import HORNS
from meshmark.testing.meshes import bumpy_sphere, icosphere
from meshmark_plugins.schemes.relief.basis import Basis
from meshmark_plugins.schemes.relief.residual import heights
from meshmark_plugins.schemes.relief.scheme import Relief
from meshmark_plugins.schemes.relief.treatment import MOST_POINTS, Treatment, subdivisions


def frame_of(mesh) -> Frame:
    V, F = mesh
    return Frame(1.0, V, Topology.from_triangles(F, len(V)))


SPHERE, HORNED = frame_of(icosphere(4)), frame_of(bumpy_sphere(4, HORNS, 1.0, 0.35))


def size(frame: Frame) -> float:
    return surface_box(frame.points, frame.faces)[0]


@pytest.fixture(scope="module")
def reliefs():
    """Heights of a random word, 1e-4 of the diagonal, on the sphere and the horned ball."""
    found = {}
    for name, frame in (("sphere", SPHERE), ("horned", HORNED)):
        basis = Basis.of(frame.points, frame.faces)
        w = np.random.default_rng(0).choice((-1.0, 1.0), basis.n_chips)
        found[name] = 1e-4 * size(frame) * basis.heights(w)
    return found


def raised(frame: Frame, f) -> np.ndarray:
    return frame.points + f[:, None] * vertex_normals(frame.points, frame.faces)


def view(frame: Frame, points, motion=None) -> AlignedFrame:
    motion = np.zeros_like(frame.points) if motion is None else motion
    return AlignedFrame(frame, motion, points, vertex_normals(points, frame.faces))


def likeness(found, f) -> float:
    return float(np.corrcoef(found.value, f)[0, 1])


def test_a_height_known_in_closed_form_is_measured() -> None:
    V, d = SPHERE.points, size(SPHERE)
    # A harmonic of degree 6, which no affine map makes.
    angle = np.arctan2(V[:, 1], V[:, 0])
    f = 1e-4 * d * (V[:, 0] ** 2 + V[:, 1] ** 2) ** 3 * np.cos(6.0 * angle)
    found = heights(view(SPHERE, V * (1.0 + f[:, None])))
    assert likeness(found, f) > 0.98
    assert found.value @ f / (f @ f) == pytest.approx(1.0, abs=0.1)
    assert found.count.sum() == pytest.approx(len(V))


@pytest.mark.parametrize("name", ["sphere", "horned"])
def test_a_relief_is_measured(name, reliefs) -> None:
    frame, f = {"sphere": SPHERE, "horned": HORNED}[name], reliefs[name]
    found = heights(view(frame, raised(frame, f)))
    assert likeness(found, f) > 0.9
    assert found.deviation == pytest.approx(1e-4 * size(frame), rel=0.25)


def test_an_affine_misalignment_is_taken_out(reliefs) -> None:
    rng, d = np.random.default_rng(1), size(SPHERE)
    A, b = np.eye(3) + 1e-3 * rng.normal(size=(3, 3)), 1e-3 * d * rng.normal(size=3)
    # As large as ten reliefs; of the unmarked copy hardly anything is left.
    bare = heights(view(SPHERE, SPHERE.points @ A.T + b))
    assert bare.deviation < 0.1 * 1e-4 * d
    marked = heights(view(SPHERE, raised(SPHERE, reliefs["sphere"]) @ A.T + b))
    assert likeness(marked, reliefs["sphere"]) > 0.9


def test_motion_is_taken_out(reliefs) -> None:
    # A pose a tenth of a frame off: a bulge that grows, of no affine map.
    motion = np.exp(-8.0 * ((SPHERE.points - (0.0, 0.0, 1.0)) ** 2).sum(axis=1))[:, None]
    motion = 0.02 * motion * SPHERE.points
    points = raised(SPHERE, reliefs["sphere"]) + 0.1 * motion
    assert likeness(heights(view(SPHERE, points, motion)), reliefs["sphere"]) > 0.9
    assert likeness(heights(view(SPHERE, points)), reliefs["sphere"]) < 0.9


@pytest.mark.parametrize("steps", [1, 5, 20, 50])
def test_steps_of_smoothing_are_taken_out_by_a_smoothed_reference(steps, reliefs) -> None:
    L = polygon_umbrella(HORNED.topology)
    bare = smooth(HORNED.points, L, steps)
    copy = smooth(raised(HORNED, reliefs["horned"]), L, steps)
    left = np.einsum("ij,ij->i", copy - bare, vertex_normals(bare, HORNED.faces))
    found = heights(view(HORNED, copy), Treatment(step=0.1, count=steps))
    assert likeness(found, left) > 0.8
    assert heights(view(HORNED, bare), Treatment(step=0.1, count=steps)).deviation < 1e-6 * size(
        HORNED
    )


def test_the_steps_are_found_without_the_key() -> None:
    frame = frame_of(bumpy_sphere(3, HORNS, 1.0, 0.35))
    relief, L = Relief(), polygon_umbrella(frame.topology)
    for steps in (0, 1, 6, 20, 50):
        copy = smooth(frame.points, L, steps)
        # As near as those steps are to each other that are tried.
        found = relief.treatment([view(frame, copy)])
        # Few long steps do what more short ones do, nearly.
        assert not found.taubin
        assert found.step * found.count == pytest.approx(0.1 * steps, rel=0.25)


def test_other_kinds_of_smoothing_are_told_apart() -> None:
    frame = frame_of(bumpy_sphere(3, HORNS, 1.0, 0.35))
    relief = Relief()
    for treatment in (Treatment(step=0.5, count=10), Treatment(step=0.5, count=30, taubin=True)):
        copy = treatment.surface(frame)[1].points
        assert relief.treatment([view(frame, copy)]) == treatment


def cage() -> Frame:
    """A horned ball of 962 points, in quads."""
    V, F = bumpy_sphere(1, HORNS, 1.0, 0.35)
    W, quads = subdivide(Topology.from_triangles(F, len(V)), "catmull_clark", 1)
    finer, quads = subdivide(quads, "catmull_clark", 1)
    return Frame(1.0, finer @ (W @ V), quads)


@pytest.mark.slow
@pytest.mark.parametrize("rule", ["loop", "catmull_clark"])
def test_a_subdivided_cage_is_read_beside_the_subdivided_reference(rule) -> None:
    frame = cage()
    basis = Basis.of(frame.points, frame.faces)
    w = np.random.default_rng(0).choice((-1.0, 1.0), basis.n_chips)
    f = 1e-4 * size(frame) * basis.heights(w)
    W, topology = subdivide(frame.topology, rule, 2)

    def subdivided(V) -> AlignedFrame:
        P = W @ V
        return AlignedFrame(frame, np.zeros_like(V), P, vertex_normals(P, topology.triangles))

    treatment = Treatment(rule, 2)
    bare, marked = subdivided(frame.points), subdivided(raised(frame, f))
    assert heights(bare, treatment).deviation < 1e-6 * size(frame)
    # Levels of subdivision are wider than the finest patches, and blur them.
    assert likeness(heights(marked, treatment), f) > 0.7
    assert likeness(heights(marked), f) < 0.6
    found = Relief().treatment([marked])
    assert found == treatment


def test_a_copy_of_as_many_vertices_is_not_taken_for_subdivided() -> None:
    frame = cage()
    assert subdivisions(len(frame.points), len(frame.points)) == []
    assert subdivisions(MOST_POINTS, 10 * MOST_POINTS) == []


def test_vertices_on_something_else_are_left_aside(reliefs) -> None:
    copy = raised(SPHERE, reliefs["sphere"])
    top = SPHERE.points[:, 2] > 0.6
    copy[top] *= 1.5
    found = heights(view(SPHERE, copy))
    assert (found.count[SPHERE.points[:, 2] > 0.8] == 0.0).all()
    assert (found.value[found.count == 0.0] == 0.0).all()
    low = SPHERE.points[:, 2] < 0.5
    assert np.corrcoef(found.value[low], reliefs["sphere"][low])[0, 1] > 0.85


def test_a_copy_inside_out_says_the_same(reliefs) -> None:
    seen = view(SPHERE, raised(SPHERE, reliefs["sphere"]))
    one, two = heights(seen), heights(replace(seen, normals=-seen.normals))
    np.testing.assert_array_equal(one.value, two.value)


def test_too_few_vertices_say_nothing() -> None:
    seen = view(SPHERE, SPHERE.points * 1.0001)
    few = replace(seen, points=seen.points[:20], normals=seen.normals[:20])
    found = heights(few)
    assert not found.count.any()
    assert not found.value.any()
