"""Points of a rest pose that slid are moved by the joints of their new places."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdSkel

from meshmark.mesh.charts import SlidPoints, equal_rows
from meshmark.mesh.topology import triangulate
from meshmark.usd.delivery import write_flattened
from meshmark.usd.influences import INDICES, WEIGHTS, Influences
from meshmark.usd.reading import read_stage
from meshmark.usd.writing import write_override
from rigged_stages import BENDS, ELBOW, Rigged, bent_tube, elbow_weights, rotation, tube

SLIDE = 0.03
TURNS = {1.0: 0.0, 2.0: 20.0, 4.0: 40.0}
V, COUNTS, CORNERS = tube()
F = triangulate(np.array(COUNTS), np.array(CORNERS))
INNER = (V[:, 0] > 0.1) & (V[:, 0] < 1.9)
ALONG = SLIDE * INNER[:, None] * np.eye(3)[0]


def dense(influences: Influences, n_joints: int) -> np.ndarray:
    found = np.zeros((len(influences.indices), n_joints))
    rows = np.arange(len(found))[:, None]
    np.add.at(found, (rows, influences.indices), influences.weights)
    return found


def follow(
    influences: Influences, F: np.ndarray, before: np.ndarray, after: np.ndarray
) -> Influences:
    alike = equal_rows(np.column_stack([before, influences.columns]))
    return influences.followed(SlidPoints.of(F, before, after, alike))


def test_weights_along_a_tube_are_those_of_the_new_place() -> None:
    """Of two joints in any order, with weights that are linear in x."""
    w = V[:, 0] / 2
    indices = np.tile([3, 1], (len(V), 1))
    indices[::2] = indices[::2, ::-1]
    weights = np.where(indices == 1, w[:, None], 1 - w[:, None])
    followed = follow(Influences(indices, weights), F, V, V + ALONG)
    expected = (V + ALONG)[:, 0] / 2
    np.testing.assert_allclose(dense(followed, 4)[:, 1], expected, atol=1e-12)
    np.testing.assert_allclose(dense(followed, 4)[:, 3], 1 - expected, atol=1e-12)


def test_as_many_joints_as_before_are_kept_and_weigh_as_much() -> None:
    """Each ring has a joint of its own: between two rings, one of two is kept."""
    ring = np.repeat(np.arange(9), 8)
    followed = follow(Influences(ring[:, None], np.full((len(V), 1), 0.7)), F, V, V + 6 * ALONG)
    # More than half of the way to the next ring.
    np.testing.assert_array_equal(followed.indices[:, 0], ring + INNER)
    np.testing.assert_allclose(followed.weights, 0.7, atol=1e-12)


def test_points_that_coincide_stay_together() -> None:
    """The faces of each ring have points of their own, as in files of games."""
    corners = np.array(CORNERS)
    own = np.arange(len(corners))
    w = elbow_weights(V)
    apart = Influences(np.tile([0, 1], (len(V), 1)), np.stack([1 - w, w], axis=1))
    whole = follow(apart, F, V, V + ALONG)
    cut = follow(
        Influences(apart.indices[corners], apart.weights[corners]),
        triangulate(np.array(COUNTS), own),
        V[corners],
        (V + ALONG)[corners],
    )
    np.testing.assert_allclose(dense(cut, 2), dense(whole, 2)[corners], atol=1e-12)


def bent_at(points: np.ndarray, degrees: float) -> np.ndarray:
    """Bend points of the tube by the weights of where they are, by linear skinning."""
    w = elbow_weights(points)[:, None]
    return (1 - w) * points + w * ((points - ELBOW) @ rotation((0, 0, 1), degrees) + ELBOW)


def twisted_at(points: np.ndarray, degrees: float) -> np.ndarray:
    """Twist points of the tube by the weights of where they are, by dual quaternions."""
    w, half = elbow_weights(points), np.deg2rad(degrees) / 2
    angles = np.rad2deg(2 * np.arctan2(w * np.sin(half), (1 - w) + w * np.cos(half)))
    turned = [p @ rotation((1, 0, 0), each) for p, each in zip(points, angles, strict=True)]
    return np.stack(turned)


def posed(file: Path) -> list[np.ndarray]:
    return [frame.points for frame in read_stage(str(file)).meshes[0]]


@pytest.mark.parametrize("write", [write_override, write_flattened])
@pytest.mark.parametrize(
    ("method", "axis", "deform"),
    [
        (UsdSkel.Tokens.classicLinear, (0, 0, 1), bent_at),
        (UsdSkel.Tokens.dualQuaternion, (1, 0, 0), twisted_at),
    ],
)
def test_a_slide_is_posed_as_it_was_planned(
    tmp_path: Path, write, method: str, axis: tuple[int, int, int], deform
) -> None:
    """The plan is what a rig makes of slid points that have the weights of their new places."""
    rigged = Rigged.at(tmp_path / "a.usda")
    binding = UsdSkel.BindingAPI(rigged.add_tube().GetPrim())
    binding.CreateSkinningMethodAttr(method)
    rigged.turn_elbow(TURNS, axis=axis)
    original = read_stage(rigged.save())
    planned = {time: deform(V + ALONG, degrees) for time, degrees in TURNS.items()}
    mesh = original.meshes[0].map(lambda frame: frame.moved(planned[frame.time]))
    off = {}
    for primvars in ("keep", "follow"):
        output = tmp_path / f"{primvars}.usda"
        write(original, replace(original, meshes=(mesh,)), output, skel="rest", primvars=primvars)
        off[primvars] = np.linalg.norm(np.subtract(posed(output), [*planned.values()]))
    assert off["keep"] > 1e-2
    assert off["follow"] < 0.3 * off["keep"]
    stage = Usd.Stage.Open(str(output))
    prim = stage.GetPrimAtPath("/man/arm")
    weights = np.array(prim.GetAttribute(WEIGHTS).Get()).reshape(-1, 2)
    indices = np.array(prim.GetAttribute(INDICES).Get()).reshape(-1, 2)
    elbow = np.where(indices == 1, weights, 0).sum(axis=1)
    # Where a point slid to is found with its old weights.
    np.testing.assert_allclose(elbow, elbow_weights(V + ALONG), atol=0.015)


def rigid(prim: Usd.Prim) -> None:
    binding = UsdSkel.BindingAPI(prim)
    binding.CreateJointIndicesPrimvar(True, 1).Set([1])
    binding.CreateJointWeightsPrimvar(True, 1).Set([1.0])


def animated(prim: Usd.Prim) -> None:
    weights = prim.GetAttribute(WEIGHTS)
    for time in BENDS:
        weights.Set(weights.Get(), time)


@pytest.mark.parametrize("change", [rigid, animated])
def test_what_is_rigid_or_animated_stays(tmp_path: Path, change) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    change(rigged.add_tube().GetPrim())
    rigged.turn_elbow(BENDS)
    original = read_stage(rigged.save())
    mesh = original.meshes[0].map(lambda frame: frame.moved(frame.points + 1e-3))
    write_override(original, replace(original, meshes=(mesh,)), tmp_path / "o.usda", skel="rest")
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "o.usda"))
    over = layer.GetPrimAtPath("/man/arm")
    assert "points" in over.attributes
    assert WEIGHTS not in over.attributes


def test_instances_have_weights_of_their_own_in_a_deliverable(tmp_path: Path) -> None:
    bent_tube(tmp_path / "a.usda")
    stage = Usd.Stage.CreateNew(str(tmp_path / "two.usda"))
    for name in ("a", "b"):
        prim = stage.DefinePrim(f"/{name}")
        prim.GetReferences().AddReference("./a.usda")
        prim.SetInstanceable(True)
    stage.GetRootLayer().Save()
    original = read_stage(str(tmp_path / "two.usda"))
    shares = {"/a/arm": 1.0, "/b/arm": -0.5}
    meshes = tuple(
        mesh.map(
            lambda frame, k=shares[mesh.prim]: frame.moved(
                bent_at(V + k * ALONG, BENDS[frame.time])
            )
        )
        for mesh in original.meshes
    )
    write_flattened(original, replace(original, meshes=meshes), tmp_path / "o.usda", skel="rest")
    shown = Usd.Stage.Open(str(tmp_path / "o.usda"))
    for path, share in shares.items():
        weights = np.array(shown.GetPrimAtPath(path).GetAttribute(WEIGHTS).Get()).reshape(-1, 2)
        changed = np.abs(weights - np.round(weights * 2) / 2).max(axis=1) > 0.01
        # A ramp ends at the rings beside the elbow: those that slid onto it have other weights.
        assert set(V[changed, 0]) == ({0.75, 1.0} if share > 0 else {1.0, 1.25})
