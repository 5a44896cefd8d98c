"""Few points stand for a mesh in all frames: positions, distances and displacements are true."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.alignment.align import align
from meshmark.detection.informed_pairs import aligned, pairs
from meshmark.errors import InputError
from meshmark.extension.recipe import Recipe, default_layers
from meshmark.mesh.animation import Frame, MappedFrames, MeshAnimation
from meshmark.mesh.asset import Asset, as_asset
from meshmark.mesh.closest_points import ClosestPoints
from meshmark.mesh.topology import Topology
from meshmark.reporting.copy_facts import copy_facts
from meshmark.reporting.decimation import shown_mesh, simplified
from meshmark.reporting.distances import Distances
from meshmark.reporting.page import LARGEST, page
from meshmark.reporting.selection import FRAMES, MESHES, select
from meshmark.reporting.view import ROOM, view_of
from meshmark.sources.reading import read
from meshmark.testing.meshes import (
    bent_tube,
    bumpy_sphere,
    dumbbell,
    icosphere,
    plane,
    side_by_side,
    torus,
)
from report_pages import asked, verdict


def moving_torus(n_frames: int = 3) -> MeshAnimation:
    V, F = torus(24, 12)
    walk = np.linspace(0.0, 30.0, n_frames)[:, None, None] * np.array([1.0, 0.0, 0.0])
    return MeshAnimation.from_arrays(V + walk, F, prim="/Ring")


def test_a_simplified_sphere_is_round_and_made_of_its_own_points() -> None:
    V, F = icosphere(4)
    kept, faces = simplified(V, F, 300)
    assert 150 < len(kept) <= 300
    assert np.allclose(np.linalg.norm(V[kept], axis=1), 1.0)
    a, b, c = V[kept][faces].swapaxes(0, 1)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    assert volume == pytest.approx(4 / 3 * np.pi, rel=0.05)
    assert (np.bincount(faces.ravel(), minlength=len(kept)) > 0).all()


def test_what_is_small_is_shown_whole() -> None:
    V, F = icosphere(1)
    shown = shown_mesh(MeshAnimation.from_arrays(V, F), 100)
    assert sorted(shown.points.tolist()) == list(range(42))
    assert len(shown.faces) == 80


def test_soup_that_cannot_be_simplified_still_has_no_more_points() -> None:
    rng = np.random.default_rng(2)
    V = rng.random((3000, 3))
    kept, faces = simplified(V, np.arange(3000).reshape(-1, 3), 200)
    assert len(kept) <= 200
    assert faces.max(initial=-1) < len(kept)


def test_a_view_follows_a_mesh_that_walks_away() -> None:
    asset = as_asset(moving_torus())
    view = view_of(asset, select(asset))
    assert view is not None
    assert np.allclose(view.positions, view.positions[:1])
    assert np.linalg.norm(np.ptp(view.positions[0], axis=0)) == pytest.approx(1.0)
    assert view.times.tolist() == [1.0, 2.0, 3.0]


def test_a_range_of_frames_is_kept_to() -> None:
    asset = as_asset(moving_torus(9))
    assert select(asset, frames="3:7:2").times.tolist() == [3.0, 5.0, 7.0]


def test_z_up_is_turned_and_not_mirrored() -> None:
    V, F = torus(12, 8)
    asset = Asset("t", (MeshAnimation.from_arrays(V, F),), "memory", up_axis="Z")
    turned = view_of(asset, select(asset)).positions[0]
    flat = view_of(as_asset(asset.meshes[0]), select(asset)).positions[0]
    assert np.allclose(turned[:, 1], flat[:, 2])
    assert np.allclose(turned[:, 2], -flat[:, 1])


def test_every_point_is_in_the_picture() -> None:
    asset = as_asset(moving_torus())
    view = view_of(asset, select(asset))
    camera = view.camera
    right, up, back = camera.axes @ (view.positions[0] - camera.position).T
    slope = np.tan(np.radians(28.0) / 2)
    assert (np.abs(up) < -back * slope).all()
    assert (np.abs(right) < -back * slope * 1.5).all()


def test_distances_of_a_copy_that_was_blown_up_along_its_normals() -> None:
    V, F = icosphere(3)
    bumps = 1.0 + 0.01 * (V[:, 2:] > 0.85)
    original = as_asset(MeshAnimation.from_arrays(V, F, prim="/Ball"))
    copy = as_asset(MeshAnimation.from_arrays(bumps * V, F, prim="/Ball"))
    distances = Distances(align(copy, original).meshes)
    found = distances((bumps * V), distances.times(copy.meshes[0].times)[0])
    diagonal = 2.0 * np.sqrt(3.0)
    assert found.min() >= 0.0
    raised = found[bumps[:, 0] > 1.0]
    assert raised.mean() > 5 * found[bumps[:, 0] == 1.0].mean()
    assert raised.mean() == pytest.approx(0.01 / diagonal, rel=0.1)


def changing(ring_size: float = 1.0) -> Asset:
    """Return a ball in three frames, and a ring in the fourth."""
    V, F = bumpy_sphere(3, np.eye(3))
    ball = Topology.from_triangles(F, len(V))
    R, E = torus(48, 20)
    frames = [Frame(float(t), (1 + 0.1 * t) * V, ball) for t in (1, 2, 3)]
    ring = Frame(4.0, R * [1.3, 1.0, 0.8 * ring_size], Topology.from_triangles(E, len(R)))
    return as_asset(MeshAnimation.from_frames([*frames, ring], prim="/Sim"))


def test_a_mesh_whose_connectivity_changes_is_measured_run_by_run() -> None:
    original, copy = changing(), changing(ring_size=1.1)
    found = pairs(copy, original)
    meshes = [mesh for pair in found for mesh in aligned(pair, copy, original).meshes]
    # Found once, for whoever asks again.
    assert aligned(found[0], copy, original) is aligned(pairs(copy, original)[0], copy, original)
    distances, (ball, _, _, ring) = Distances(meshes), list(copy.meshes[0])
    assert distances(ball.points, 1.0).max() < 1e-6
    assert distances(ring.points, 4.0).max() > 1e-3
    chosen = select(copy)
    assert chosen.at(distances.times(chosen.lead.times)).times.tolist() == [1.0, 2.0, 3.0]
    text = page(copy_facts(asked(), verdict()), view_of(copy, chosen))
    assert "points in 3 of 4 frames" in text
    assert "The connectivity of /Sim changes over time. Of its 2 runs of frames in which" in text
    assert "the longest is shown, frames 1:3." in text


@pytest.mark.slow
def test_a_pose_that_the_original_never_takes_is_no_distance() -> None:
    (V, F), (Q, _) = bent_tube(16, 40, angle=0.3), bent_tube(16, 40, angle=1.5)
    original, copy = (as_asset(MeshAnimation.from_arrays(P, F, prim="/Tube")) for P in (V, Q))
    placed = align(copy, original)
    assert placed.meshes[0].method == "reposed"
    bent = Distances(placed.meshes)(Q, 1.0)
    # Laid upon the pose that it takes, the tube is off by its own radius at the ends.
    start = placed.meshes[0].frames[0].maps["similarity"](Q)
    apart = ClosestPoints(V, F).distances(start) / np.linalg.norm(np.ptp(V, axis=0))
    assert np.median(bent) < 1e-3
    assert np.median(apart) > 5e-3


def test_displacements_are_those_of_the_marked_points() -> None:
    plain = moving_torus()
    up = np.array([0.0, 0.01, 0.0])
    moved = plain.map(lambda frame: frame.moved(frame.points + up))
    asset = as_asset(plain)
    view = view_of(asset, select(asset), label="moved", marked=as_asset(moved))
    diagonal = np.linalg.norm(np.ptp(plain[0].points, axis=0))
    assert np.allclose(view.moves, up / diagonal)
    assert np.allclose(view.heat.values, 0.01 / diagonal)


def test_parts_are_connected_surfaces_and_have_names() -> None:
    V, F = icosphere(2)
    mesh = side_by_side((V - [2.0, 0.0, 0.0], F), (V + np.array([2.0, 0.0, 0.0]), F))
    asset = as_asset(MeshAnimation.from_arrays(*mesh, prim="/Balls"))
    view = view_of(asset, select(asset))
    assert view.legend == ("/Balls, part 1", "/Balls, part 2")
    sides = [set(view.parts[view.positions[0][:, 0] * s > 0.1].tolist()) for s in (-1, 1)]
    assert all(len(side) == 1 for side in sides)
    assert sides[0] != sides[1]


def unreadable(frame: Frame) -> Frame:
    if frame.time == 2.0:
        raise InputError("broken")
    return frame


def test_parts_are_those_of_the_segmenter_if_a_scheme_needs_one() -> None:
    asset = as_asset(MeshAnimation.from_arrays(*dumbbell(24, 48), prim="/Bell"))
    view = view_of(asset, select(asset, [Recipe("tsai2014")]))
    assert len(view.legend) > 1
    x = view.positions[0][:, np.ptp(view.positions[0], axis=0).argmax()]
    ends = [set(view.parts[side].tolist()) for side in (x < -0.3, x > 0.3)]
    assert ends[0] != ends[1]


def test_frames_that_cannot_be_read_are_left_out() -> None:
    mesh = moving_torus()
    broken = MeshAnimation(mesh.times, MappedFrames(mesh.source, unreadable), prim="/Ring")
    asset = as_asset(broken)
    assert view_of(asset, select(asset)).times.tolist() == [1.0, 3.0]


def test_what_cannot_be_shown_is_no_view() -> None:
    V, F = plane(3)
    nowhere = as_asset(MeshAnimation.from_arrays(np.zeros_like(V), F))
    assert select(nowhere) is None


def test_many_frames_and_meshes_have_room() -> None:
    V, F = icosphere(2)
    frames = np.repeat(V[None], 40, axis=0)
    meshes = tuple(
        MeshAnimation.from_arrays(frames + 3.0 * i, F, prim=f"/Ball{i}") for i in range(60)
    )
    asset = Asset("many", meshes, "memory")
    chosen = select(asset)
    assert len(chosen.meshes) == MESHES
    assert chosen.n_meshes == 60
    view = view_of(asset, chosen, label="moved", marked=asset)
    T, n, _ = view.positions.shape
    assert T <= FRAMES
    assert 10 * T * n + 12 * n < ROOM


@pytest.mark.slow
def test_a_page_of_the_elephant_in_48_frames_is_below_two_megabytes(data_folder) -> None:
    asset = read(data_folder / "elephant-gallop.usdc")
    view = view_of(asset, select(asset, default_layers()), label="Moved", marked=asset)
    facts = copy_facts(asked(), verdict(prims=60, frames=400))
    size = len(page(facts, view).encode())
    assert view.selection.n_points == 42_321
    assert view.selection.n_frames == 48
    assert size < LARGEST
