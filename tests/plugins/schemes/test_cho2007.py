from __future__ import annotations

import numpy as np
import pytest

from meshmark.detection.extraction import extract
from meshmark.detection.significance import judge
from meshmark.embedding.mesh import embed_animation
from meshmark.errors import CapacityError, UsageError
from meshmark.extension.binned_scheme import as_scheme
from meshmark.extension.carrier import measure
from meshmark.extension.closed_loop import drive, settle
from meshmark.extension.registry import make_attack
from meshmark.keys import Key
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.topology import Topology
from meshmark.metrics import distortion
from meshmark.sources.reading import read
from meshmark.testing.meshes import icosphere
from meshmark_plugins.schemes.cho2007.norms import bin_norms
from meshmark_plugins.schemes.cho2007.power import exponents
from meshmark_plugins.schemes.cho2007.scheme import Cho2007

KEY = Key(bytes(range(32)))
AXES = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])


def star(radii: np.ndarray) -> np.ndarray:
    """Put four points at each radius, so that their centre is the origin."""
    return (np.asarray(radii)[:, None, None] * AXES).reshape(-1, 3)


def rough_sphere(level: int = 4, size: float = 0.3) -> Frame:
    """Build a sphere whose radii are spread evenly over a shell, alike at opposite ends."""
    V, F = icosphere(level)
    radius = 1.0 + size * (997 * np.abs(V @ [1.0, 0.3, 0.7]) % 1.0)
    return Frame(1.0, V * radius[:, None], Topology.from_triangles(F, len(V)))


def test_power_map_reaches_the_mean_of_uniform_numbers() -> None:
    # The mean of u^k over [0, 1] is 1 / (1 + k).
    u = (np.arange(4000) + 0.5) / 4000
    for mean in (0.4, 0.5, 0.55, 0.7):
        (k,) = exponents(u, np.zeros(4000, dtype=int), np.array([mean]))
        assert k == pytest.approx(1 / mean - 1, rel=1e-3)
        assert np.mean(u**k) == pytest.approx(mean, abs=1e-12)


def test_every_bin_gets_its_own_exponent() -> None:
    rng = np.random.default_rng(1)
    u, bins = rng.random(900), rng.integers(0, 3, 900)
    target = np.array([0.3, 0.5, 0.8])
    k = exponents(u, bins, target)
    means = [np.mean(u[bins == i] ** k[i]) for i in range(3)]
    np.testing.assert_allclose(means, target, atol=1e-12)
    assert k[0] > 1 > k[2]


def test_what_no_exponent_reaches_ends_at_the_end() -> None:
    u, bins = np.array([0.0, 1.0, 0.0, 0.5, 1.0]), np.array([0, 0, 1, 1, 1])
    k = exponents(u, bins, np.array([0.9, 0.99]))
    assert k == pytest.approx([1 / 256, 1 / 256])
    assert exponents(u, bins, np.array([0.1, 0.1]))[1] == pytest.approx(256)


def test_norms_are_binned_evenly_and_normalised_by_what_is_in_the_bin() -> None:
    # Range 1 to 3 in four bins: 1 - 1.5, 1.5 - 2 with a single norm, 2 - 2.5 empty, 2.5 - 3.
    radii = np.array([1.0, 1.1, 1.4, 1.7, 2.6, 2.7, 3.0])
    made = bin_norms(star(radii) + np.array([5, 6, 7]), 4)
    np.testing.assert_allclose(made.centre, [5, 6, 7])
    np.testing.assert_allclose(made.norm[::4], radii)
    assert made.bins[::4].tolist() == [0, 0, 0, -1, 3, 3, 3]
    np.testing.assert_allclose(made.bin_fraction[::4], [0, 0.25, 1, 0, 0, 0.25, 1], atol=1e-12)
    np.testing.assert_allclose(made.width, [0.4, 0, 0, 0.4], atol=1e-12)
    chips = measure([made])
    assert chips.held.tolist() == [[True, False, False, True]]
    np.testing.assert_allclose(chips.value, [[1.25 / 3 - 0.5, 0, 0, 1.25 / 3 - 0.5]])


def test_a_move_shifts_means_by_what_is_asked_along_rays_from_the_centre() -> None:
    frame = rough_sphere()
    np.testing.assert_allclose(frame.points.mean(axis=0), 0, atol=1e-12)
    made = Cho2007(bits=8)
    carriers = made.carriers(frame, None)
    shift = np.array([0.04, -0.04, 0.0, 0.1, -0.1, 0.0, 0.02, -0.02])
    points = made.move(frame, None, carriers, [shift], np.random.default_rng(0))
    # Opposite points move alike: the centre stays, so nothing but the power map is seen.
    change = measure(made.carriers(frame.moved(points), None)).value - measure(carriers).value
    np.testing.assert_allclose(change[0], shift, atol=1e-9)
    np.testing.assert_allclose(np.cross(points, frame.points), 0, atol=1e-12)
    still = np.isin(carriers[0].bins, [2, 5])
    np.testing.assert_array_equal(points[still], frame.points[still])
    order = np.argsort(carriers[0].norm)
    assert np.diff(np.linalg.norm(points[order], axis=1)).min() > -1e-12
    ends = np.isin(carriers[0].bin_fraction, [0.0, 1.0])
    np.testing.assert_array_equal(points[ends], frame.points[ends])


def test_the_loop_brings_every_chip_to_its_target_though_the_centre_moves() -> None:
    V, F = icosphere(4)
    rng = np.random.default_rng(2)
    V = V * (1 + 0.3 * rng.random(len(V)))[:, None] * [1.0, 1.2, 1.5]
    frame = Frame(1.0, V, Topology.from_triangles(F, len(V)))
    made = Cho2007(bits=16, strength=0.08)
    plan = settle(frame, made, KEY.words("cho2007", 1, 16), KEY.generator("embed/cho2007"), 1e-7)
    marked = frame.moved(drive(frame, plan))
    assert np.linalg.norm(marked.points.mean(axis=0) - V.mean(axis=0)) > 1e-6
    aimed = measure(made.carriers(marked, None)).value * plan.words
    assert aimed.min() >= 0.08


def test_the_key_is_found_through_float32_and_no_other(creature) -> None:
    animation = creature.select([3, 15])
    made = Cho2007()
    marked = embed_animation(animation, as_scheme(made), "cho2007", KEY).animation
    stored = marked.map(as_float32)
    found = extract(stored, as_scheme(made), "cho2007")
    assert found.chips >= 60
    assert judge(found, KEY).errors.maximum <= 0.05
    assert judge(found, KEY).log10_p < -15
    assert judge(found, Key(bytes(32))).log10_p > -2
    assert judge(extract(animation, as_scheme(made), "cho2007"), KEY).log10_p > -2


def test_frames_of_other_connectivity_are_found_too(creature) -> None:
    frame = creature[5]
    made = Cho2007()
    marked = embed_animation(
        MeshAnimation.from_frames([frame]), as_scheme(made), "cho2007", KEY
    ).animation[0]
    order = np.random.default_rng(3).permutation(len(marked.points))
    new = np.argsort(order)
    mixed = Topology.from_triangles(new[marked.faces], len(order))
    both = [marked, Frame(frame.time + 1, marked.points[order], mixed)]
    found = judge(extract(MeshAnimation.from_frames(both), as_scheme(made), "cho2007"), KEY)
    assert found.log10_p_per_frame[0] == pytest.approx(found.log10_p_per_frame[1])
    assert found.log10_p < -15


def test_what_cannot_hold_a_mark_is_refused_with_the_reason() -> None:
    ball, F = icosphere(3)
    frame = Frame(1.0, ball, Topology.from_triangles(F, len(ball)))
    with pytest.raises(CapacityError, match="equally far from their centre"):
        Cho2007().layout(frame)
    with pytest.raises(CapacityError, match=r"642 points cannot hold 200 bits; .* least 800"):
        Cho2007(bits=200).layout(frame)


@pytest.mark.parametrize(
    ("parameters", "named"),
    [({"bits": 1}, "bits"), ({"bits": 8.5}, "bits"), ({"strength": 0.5}, "strength")],
)
def test_impossible_parameters_are_refused_by_name(parameters, named) -> None:
    with pytest.raises(UsageError, match=f"scheme cho2007: {named} must be"):
        Cho2007(**parameters)


def test_moves_are_not_carried_from_frame_to_frame() -> None:
    frame = rough_sphere(2)
    with pytest.raises(UsageError, match="carries no moves"):
        Cho2007().carry(frame, None, frame, frame, np.ones((1, 64), dtype=np.int64))


def test_a_horse_frame_survives_light_noise_and_rounding(data_folder) -> None:
    horse = read(str(data_folder / "horse-gallop.usdc")).meshes[0].select([0])
    made = Cho2007()
    marked = embed_animation(horse, as_scheme(made), "cho2007", KEY).animation.map(as_float32)
    spent = distortion(horse, marked)
    assert spent.mrms_rel < 3e-4
    assert spent.flipped_faces == 0
    attacks = [make_attack("noise", amplitude=0.001), make_attack("quantization", bits=10)]
    for attack in attacks:
        attacked = attack.apply(marked, np.random.default_rng(0))
        found = judge(extract(attacked, as_scheme(made), "cho2007"), KEY)
        assert found.errors.maximum <= 0.05
        assert found.log10_p < -12
    # What it is known to be weak against: smoothing wipes the shells out.
    smooth = make_attack("smoothing", iterations=30).apply(marked, np.random.default_rng(0))
    assert judge(extract(smooth, as_scheme(made), "cho2007"), KEY).errors.maximum > 0.2


def as_float32(frame: Frame) -> Frame:
    """Round points as a file does."""
    return frame.moved(frame.points.astype(np.float32).astype(np.float64))


@pytest.mark.parametrize("n", [400, 5000])
def test_points_that_are_all_as_far_from_the_centre_are_refused(n) -> None:
    angle = np.linspace(0.0, 2 * np.pi, n, endpoint=False)
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    V = np.concatenate([ring, ring + np.array([0, 0, 3.0])])
    i, j = np.arange(n), (np.arange(n) + 1) % n
    F = np.concatenate([np.column_stack([i, j, i + n]), np.column_stack([j, j + n, i + n])])
    with pytest.raises(CapacityError, match="equally far"):
        Cho2007().layout(Frame(1.0, V, Topology.from_triangles(F, len(V))))
