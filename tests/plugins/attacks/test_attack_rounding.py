from __future__ import annotations

import numpy as np
import pytest

from meshmark.errors import InputError
from meshmark.mesh.animation import MeshAnimation
from meshmark.testing.attacks import AttackSuite, bending_ball, sphere
from meshmark_plugins.attacks import RECORDS

BY_NAME = {record.name: record for record in RECORDS}


class TestQuantization(AttackSuite):
    @pytest.fixture
    def record(self):
        return BY_NAME["quantization"]


class TestQuantizationOfTheWholeAnimation(TestQuantization):
    @pytest.fixture
    def parameters(self):
        return {"per": "animation"}


class TestGltfQuantization(AttackSuite):
    @pytest.fixture
    def record(self):
        return BY_NAME["gltf-quantization"]


class TestFloat16(AttackSuite):
    @pytest.fixture
    def record(self):
        return BY_NAME["float16"]


class TestObjDigits(AttackSuite):
    @pytest.fixture
    def record(self):
        return BY_NAME["obj-digits"]


def attacked(name, animation, **parameters):
    return BY_NAME[name].factory(**parameters).apply(animation, np.random.default_rng(0))


@pytest.mark.parametrize("bits", [1, 4, 7])
def test_r_bits_leave_two_to_the_r_positions_on_every_axis(bits):
    V, F = sphere(4000)
    still = MeshAnimation.from_arrays(V * [1, 5, 25] + 3, F)
    rounded = attacked("quantization", still, bits=bits)[0].points
    before = still[0].points
    step = np.ptp(before, axis=0) / (2**bits - 1)
    for axis in range(3):
        assert len(np.unique(rounded[:, axis])) == 2**bits
    assert np.all(np.abs(rounded - before) <= step / 2 * (1 + 1e-9))
    np.testing.assert_allclose(np.ptp(rounded, axis=0), np.ptp(before, axis=0))


def test_quantizing_twice_changes_nothing_more():
    once = attacked("quantization", bending_ball(), bits=6)
    twice = attacked("quantization", once, bits=6)
    for one, two in zip(once, twice, strict=True):
        np.testing.assert_allclose(two.points, one.points, atol=1e-12)


def test_a_flat_mesh_keeps_its_flat_axis():
    V = np.array([[0.0, 0, 7.123], [1, 0, 7.123], [0.3, 1, 7.123]])
    flat = MeshAnimation.from_arrays(V, np.array([[0, 1, 2]]))
    rounded = attacked("quantization", flat, bits=1)[0].points
    np.testing.assert_array_equal(rounded, [[0, 0, 7.123], [1, 0, 7.123], [0, 1, 7.123]])


def test_one_grid_for_all_frames_is_wider_than_each_frames_own():
    V, F = sphere(500)
    growing = MeshAnimation.from_arrays(np.stack([V, 3 * V]), F)
    low, step = -3.0, 6.0 / 15
    rounded = attacked("quantization", growing, bits=4, per="animation")
    for frame in rounded:
        k = (frame.points - low * 3 * np.ptp(V, axis=0) / 6) / (step * 3 * np.ptp(V, axis=0) / 6)
        assert frame.points.shape == V.shape
        assert np.isfinite(k).all()
    positions = [len(np.unique(frame.points[:, 2])) for frame in rounded]
    assert positions[1] == 16
    assert positions[0] in (6, 7)
    own = attacked("quantization", growing, bits=4)
    assert [len(np.unique(frame.points[:, 2])) for frame in own] == [16, 16]


def test_gltf_steps_are_the_same_on_all_axes():
    V, F = sphere(4000)
    still = MeshAnimation.from_arrays(V * [1, 2, 4], F)
    rounded = attacked("gltf-quantization", still, bits=6)[0].points
    step = np.ptp(V[:, 2]) * 4 / 63
    k = (rounded - still[0].points.min(axis=0)) / step
    np.testing.assert_allclose(k, np.round(k), atol=1e-9)
    assert np.abs(rounded - still[0].points).max() <= step / 2 * (1 + 1e-9)
    assert len(np.unique(np.round(k[:, 0]))) <= 18


def test_half_precision_has_eleven_bits():
    V, F = sphere(1000)
    still = MeshAnimation.from_arrays(V * 100, F)
    rounded = attacked("float16", still)[0].points
    np.testing.assert_array_equal(rounded, rounded.astype(np.float16))
    np.testing.assert_allclose(rounded, still[0].points, rtol=2.0**-11, atol=2.0**-24)
    assert np.abs(rounded - still[0].points).max() > 100 * 2.0**-13


def test_what_does_not_fit_into_half_precision_is_said():
    far = MeshAnimation.from_arrays(*sphere(50), prim="/A", origin="a.usda")
    far = far.map(Away())
    with pytest.raises(InputError, match=r"a\.usda: /A: frame 1: the coordinate .* does not fit"):
        attacked("float16", far)[0]


class Away:
    def __call__(self, frame):
        return frame.moved(frame.points + 1e6)


def test_fixed_digits_are_those_after_the_point():
    V = np.array([[1.23456, 0, -0.00004], [1234.56785, 0.5, 2e-7], [1, 2, 3]])
    still = MeshAnimation.from_arrays(V, np.array([[0, 1, 2]]))
    rounded = attacked("obj-digits", still, digits=4)[0].points
    text = [[float(f"{x:.4f}") for x in row] for row in V]
    np.testing.assert_allclose(rounded, text, atol=1e-12)


def test_significant_digits_are_those_of_the_g_format():
    V = np.random.default_rng(0).normal(size=(90, 3)) * 10.0 ** np.arange(-8, 10).repeat(5)[:, None]
    V[0] = 0.0
    still = MeshAnimation.from_arrays(V, np.array([[0, 1, 2]]))
    rounded = attacked("obj-digits", still, digits=3, kind="significant")[0].points
    text = [[float(f"{x:.3g}") for x in row] for row in V]
    np.testing.assert_allclose(rounded, text, rtol=1e-12)
