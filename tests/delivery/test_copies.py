"""Copies of a shape are found through whatever was done to them, and nothing else is."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.delivery.clouds import find_cloud
from meshmark.delivery.copies import Match, Shape, find_in_order
from meshmark.testing.attacks import sphere
from meshmark.testing.meshes import icosphere

RNG = np.random.default_rng(7)
V, F = sphere(1200)
BUMPS = 1 + 0.2 * np.sin(4 * V @ [1.0, 0.2, -0.4]) + 0.3 * V[:, 0] ** 3
POSES = {
    float(t): V * BUMPS[:, None] * [1.0, 0.7, 1.9] + 0.02 * t * np.sin(3 * V[:, ::-1]) + [5, 0, t]
    for t in range(1, 7)
}
CORNERS = F.reshape(-1)
N = len(V)
TURN = np.linalg.qr(RNG.normal(size=(3, 3)))[0]
SHEAR = RNG.normal(size=(3, 3))
ANY_ORDER = RNG.permutation(N)


@pytest.fixture(scope="module")
def shape() -> Shape:
    made = Shape(N, CORNERS, POSES.__getitem__)
    for time, points in POSES.items():
        made.add(time, points)
    return made


def in_order(values: np.ndarray, shape: Shape, layout: int = 0) -> list[Match]:
    vertices, samples = list(shape.layouts())[layout]
    return list(find_in_order(values.astype(np.float64), shape, vertices, samples))


@pytest.mark.parametrize("time", POSES)
@pytest.mark.parametrize(
    ("change", "residual"),
    [
        (lambda P: P, 1e-12),
        (lambda P: P * 0.01, 1e-12),
        (lambda P: P @ TURN * 39.37 - 1000, 1e-12),
        (lambda P: P @ SHEAR + [1, 2, 3], 1e-12),
        (lambda P: P.astype(np.float16), 1e-3),
        (lambda P: np.nextafter(P.astype(np.float32), np.float32(9)), 1e-6),
        (lambda P: P.round(3), 1e-3),
        (lambda P: np.rint(P * 500), 1e-3),
        (lambda P: P + 3e-4 * RNG.normal(size=P.shape), 1e-3),
    ],
    ids=["same", "scaled", "turned", "sheared", "half", "next", "decimals", "integers", "noise"],
)
def test_a_copy_in_order_is_found_with_its_time(
    shape: Shape, time: float, change, residual: float
) -> None:
    copy = np.asarray(change(POSES[time]), dtype=np.float64)
    [match] = in_order(copy, shape)
    assert match.time == time
    assert match.columns.tolist() == [0, 1, 2]
    assert match.residual < residual
    np.testing.assert_allclose(match.image(POSES[time]), copy, atol=4 * residual * np.ptp(copy))


def test_corners_and_single_coordinates(shape: Shape) -> None:
    [match] = in_order(POSES[3.0][CORNERS] @ TURN, shape, layout=1)
    np.testing.assert_array_equal(match.vertices, CORNERS)
    among = np.column_stack([RNG.normal(size=N), np.ones(N), 2 * POSES[2.0][:, 1] + 1])
    [match] = in_order(among, shape)
    assert (match.time, match.columns.tolist()) == (2.0, [2])


@pytest.mark.parametrize(
    "change",
    [
        lambda P: P[ANY_ORDER],
        lambda P: P[ANY_ORDER] * 0.01,
        lambda P: P[ANY_ORDER] @ TURN * 3 + 9,
        lambda P: P[ANY_ORDER] @ SHEAR + 9,
        lambda P: P[:-1],
        lambda P: P[::2] @ SHEAR,
        lambda P: P[ANY_ORDER[: N // 2]],
        lambda P: P[ANY_ORDER[: 3 * N // 4]] * 0.01 + 3,
        lambda P: P[ANY_ORDER[: 3 * N // 4]] @ TURN + 1,
        lambda P: P[: N // 3] @ SHEAR,
        lambda P: P[N // 3 :] @ SHEAR,
        lambda P: P[P[:, 0] > np.median(P[:, 0])],
        lambda P: np.concatenate([P, P])[RNG.permutation(2 * N)],
        lambda P: np.concatenate([RNG.normal(size=(1500, 3)), P * 0.1]),
        lambda P: P[ANY_ORDER].astype(np.float16),
    ],
    ids=[
        "permuted", "permuted and scaled", "permuted and turned", "permuted and sheared",
        "one less", "every other", "random half", "random part scaled", "random part turned",
        "head", "tail", "cut in two", "twice", "among others", "half precision",
    ],
)  # fmt: skip
def test_a_cloud_is_found(shape: Shape, change) -> None:
    copy = np.asarray(change(POSES[4.0]), dtype=np.float64)
    match = find_cloud(copy, shape)
    assert match is not None
    assert match.time == 4.0
    off = match.image(POSES[4.0]) - copy[match.rows]
    assert np.abs(off).max() < 3e-3 * np.ptp(copy)
    assert len(match.rows) >= 0.4 * len(copy)


def test_a_matrix_to_world_space_is_tried(shape: Shape) -> None:
    world = np.eye(4)
    world[:3, :3], world[3, :3] = SHEAR, [100, 0, 0]
    part = POSES[1.0][POSES[1.0][:, 2] > np.median(POSES[1.0][:, 2])][::-1]
    match = find_cloud(part @ SHEAR + [100, 0, 0], shape, to_world=lambda _: world)
    assert match is not None
    assert match.residual < 1e-9


def test_what_is_no_copy_is_left_alone(shape: Shape) -> None:
    P = POSES[1.0]
    normals = P - P.mean(axis=0)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    bent = P + 0.05 * np.sin(6 * P[:, [1, 2, 0]])
    others = {
        "noise": RNG.normal(size=(N, 3)),
        "constant": np.ones((N, 3)),
        "normals": normals,
        "another surface": V * [1.0, 0.7, 1.9] + [5, 0, 1],
        "another pose": bent,
        "a power": np.abs(P) ** 1.2,
    }
    for name, values in others.items():
        assert in_order(values, shape) == [], name
        assert find_cloud(values, shape) is None, name
        assert find_cloud(values[ANY_ORDER][: N // 2], shape) is None, name
    ball, _ = icosphere(3)
    assert find_cloud(ball * [1, 1.1, 2], shape) is None
    assert find_cloud(np.full((50, 3), np.nan), shape) is None
    assert find_cloud(P[:20], shape) is None


def test_boxes_are_compared_as_they_are() -> None:
    box = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    made = Shape(8, np.arange(8), lambda _: box)
    made.add(1.0, box)
    assert len(in_order(box, made)) == 1
    assert in_order(box * 2, made) == []
    assert in_order(box + 1, made) == []


def test_of_poses_that_are_alike_the_one_of_the_same_time_counts() -> None:
    made = Shape(N, CORNERS, lambda _: V * BUMPS[:, None])
    for time in (1.0, 2.0, 3.0):
        made.add(time, V * BUMPS[:, None])
    vertices, samples = next(made.layouts())
    [match] = find_in_order(V * BUMPS[:, None], made, vertices, samples, hint=2.0)
    assert match.time == 2.0
    found = find_cloud((V * BUMPS[:, None])[ANY_ORDER], made, hint=3.0)
    assert found is not None
    assert found.time == 3.0
