"""glTF files of others: the same man in four encodings, and as USD's own skinning has him."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdSkel
from scipy.spatial import cKDTree

from meshmark.mesh.animation import MeshAnimation
from meshmark_plugins.readers.gltf.reader import GltfReader
from meshmark_plugins.readers.gltf.skins import Binding

DECODERS = {"CesiumMan.draco.glb": "DracoPy", "CesiumMan.meshopt.glb": "meshopt"}
SKIN = "/CesiumMan/Geom/Z_UP/Armature/Skeleton_torso_joint_1_3/Cesium_Man_2"


@pytest.fixture
def read(data_folder):
    """Return a function that reads a file of the reference assets."""

    def read_one(name: str, **parameters) -> MeshAnimation:
        if name in DECODERS:
            pytest.importorskip(DECODERS[name], reason="an optional library is absent")
        source = str(data_folder / "gltf" / name)
        [mesh] = GltfReader(**parameters).read(source).meshes
        return mesh

    return read_one


class SkinnedByUsd:
    """The man of the USD package, skinned by UsdSkel.

    His converter turned him a quarter about the upright axis, which is left out here.
    """

    def __init__(self, path: Path) -> None:
        self.stage = Usd.Stage.Open(str(path))
        mesh = self.stage.GetPrimAtPath(SKIN)
        root = UsdSkel.Root.Find(mesh)
        # The queries live as long as their cache.
        self.cache = UsdSkel.Cache()
        self.cache.Populate(root, Usd.PrimDefaultPredicate)
        [binding] = self.cache.ComputeSkelBindings(root, Usd.PrimDefaultPredicate)
        self.skeleton = self.cache.GetSkelQuery(binding.GetSkeleton())
        [self.target] = binding.GetSkinningTargets()
        self.rest = UsdGeom.Mesh(mesh).GetPointsAttr()
        upright = self.stage.GetPrimAtPath("/CesiumMan/Geom/Z_UP")
        self.world = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(upright))

    def points(self, time: float) -> np.ndarray:
        points = self.rest.Get()
        moves = self.skeleton.ComputeSkinningTransforms(time)
        assert self.target.ComputeSkinnedPoints(moves, points, time)
        return np.array(points, dtype=np.float64) @ self.world[:3, :3] + self.world[3, :3]


def size(points: np.ndarray) -> float:
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def test_the_man_stands_where_usd_has_him(read, data_folder):
    man = read("CesiumMan.glb")
    usd = SkinnedByUsd(data_folder / "usd" / "CesiumMan.usdz")
    # A key is at time code t = 24 seconds; USD has the first at 1.
    np.testing.assert_array_equal(man.times, np.arange(49))
    for index in range(1, 49):
        wanted = usd.points(float(index))
        assert np.abs(man[index].points - wanted).max() < 1e-5 * size(wanted)


# What the files round, as shares of the size: positions to 11 bits (Draco) and 14; rotations to 16
# bits, at 30 keys a second where the man has 24; and weights to 8 bits.
ROUNDED = [
    ("CesiumMan.draco.glb", 3.2e-4, 0.0, 3.4e-4),
    ("CesiumMan.quantized.glb", 3.9e-5, 3.5e-5, 4.7e-4),
    ("CesiumMan.meshopt.glb", 3.9e-5, 3.5e-5, 4.7e-4),
]


def bound(mesh: MeshAnimation) -> np.ndarray:
    """Return the points at rest in the space of the first joint, whatever they are stored in."""
    frames = mesh.source
    to_joint = frames.binding.inverse_bind[0]
    return frames.geometry.vertices.points @ to_joint[:3, :3].T + to_joint[:3, 3]


@pytest.mark.parametrize(("name", "points", "joints", "all_together"), ROUNDED)
def test_compressed_men_are_the_same_but_for_what_their_files_round(
    read, name, points, joints, all_together
):
    man, other = read("CesiumMan.glb"), read(name, fps=24)
    np.testing.assert_array_equal(man.times, other.times)
    assert len(man[0].faces) == len(other[0].faces)
    one, two = bound(man), bound(other)
    apart, same = cKDTree(one).query(two)
    assert apart.max() < points * size(one)
    weights = man.source.binding.weights.toarray()[same, :-1]
    stored = other.source.binding.weights.toarray()[:, :-1]
    np.testing.assert_allclose(np.sort(stored), np.sort(weights), atol=6e-3 if joints else 0)
    # The same man with the joints of the other file, and his own points and weights.
    rig = replace(man.source, rig=other.source.rig, binding=joined(man, other))
    # Where the keys of 24 and of 30 a second meet.
    for index in range(0, 49, 4):
        wanted = man[index].points
        extent = size(wanted)
        assert np.abs(other[index].points - wanted[same]).max() < all_together * extent
        assert np.abs(rig.frame(index).points - wanted).max() < max(joints, 1e-5) * extent


def joined(man: MeshAnimation, other: MeshAnimation) -> Binding:
    """Bind the points of one man to the joints of another, which are bound in another space."""
    of_man, of_other = man.source.binding, other.source.binding
    change = np.linalg.inv(of_other.inverse_bind[0]) @ of_man.inverse_bind[0]
    return replace(of_man, inverse_bind=of_other.inverse_bind @ change)


def test_meshopt_loses_nothing_of_the_quantised_man(read):
    one, two = read("CesiumMan.quantized.glb"), read("CesiumMan.meshopt.glb")
    assert len(one) == len(two) == 61
    for index in (0, 17, 60):
        np.testing.assert_array_equal(one[index].points, two[index].points)


@cache
def extents(mesh: MeshAnimation) -> np.ndarray:
    return np.array([np.ptp(frame.points, axis=0) for frame in mesh])


@pytest.mark.parametrize(("clip", "frames"), [("", 83), ("Walk", 18), ("Run", 28)])
def test_the_fox_has_three_clips(read, clip, frames):
    fox = read("Fox.glb", clip=clip)
    assert len(fox) == frames
    assert fox[0].topology.n_points == 1728
    assert len(fox[0].faces) == 576
    # It moves, but keeps about its length.
    assert np.ptp(extents(fox)[:, 2]) > 1
    assert extents(fox)[:, 2].min() > 0.7 * extents(fox)[:, 2].max()


def test_morphs_reach_their_targets(read):
    ball = read("AnimatedMorphSphere.glb")
    np.testing.assert_allclose(extents(ball)[0], 2, rtol=1e-5)
    assert len(ball) == 217
    assert extents(ball).max() > 4
    bars = read("MorphStressTest.gltf", clip="TheWave")
    assert len(bars) == 48
    assert bars[0].topology.n_points == 24 + 1504
    assert np.ptp(extents(bars)[:, 1]) > 0.1
