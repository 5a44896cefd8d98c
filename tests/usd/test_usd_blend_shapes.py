"""Blend shapes move points of a rest pose that slid as their new places."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdSkel, Vt

from meshmark.mesh.asset import Asset
from meshmark.mesh.charts import SlidPoints
from meshmark.mesh.topology import triangulate
from meshmark.usd.blend_shapes import Shape
from meshmark.usd.delivery import write_flattened
from meshmark.usd.reading import read_stage
from meshmark.usd.writing import write_override
from rigged_stages import Rigged, tube

V, COUNTS, CORNERS = tube()
F = triangulate(np.array(COUNTS), np.array(CORNERS))
X = np.eye(3)[0]
INNER = (V[:, 0] > 0.1) & (V[:, 0] < 1.9)
ALONG = 0.05 * INNER[:, None] * X
# Of the shape, by time; its in-between is at one half.
WEIGHTS = {1.0: 0.0, 2.0: 0.5, 3.0: 1.0, 4.0: 0.75}
SMILE = "/man/arm/smile"


def leaning(points: np.ndarray) -> np.ndarray:
    """Offsets that are linear in the place."""
    return points @ np.array([[0.2, 0.5, 0.0], [0.0, 0.0, 0.1], [0.0, 0.3, 0.0]])


def waving(points: np.ndarray) -> np.ndarray:
    """Offsets to one side, by a wave along the tube."""
    return 0.3 * np.sin(2 * points[:, :1]) * np.eye(3)[1]


def slid(move: np.ndarray) -> SlidPoints:
    return SlidPoints.of(F, V, V + move, np.arange(len(V)))


def shape(vertices: np.ndarray | None = None, **offsets: np.ndarray) -> Shape:
    rows = np.zeros(0, dtype=np.int64) if vertices is None else vertices
    return Shape(Usd.Prim(), rows, {k: v.astype(np.float32) for k, v in offsets.items()})


def test_offsets_are_those_of_the_new_place() -> None:
    followed = shape(offsets=leaning(V)).followed(slid(ALONG))
    np.testing.assert_allclose(followed.offsets["offsets"], leaning(V + ALONG), atol=1e-6)
    assert followed.vertices.size == 0


def test_a_shape_of_some_points_grows_by_those_that_slid_into_it() -> None:
    """The rings from x = 1 on are listed, backwards: that at 0.75 slides a fifth of the way."""
    listed = np.flatnonzero(V[:, 0] > 0.9)[::-1]
    offsets = np.tile(np.eye(3)[1], (len(listed), 1))
    followed = shape(listed, offsets=offsets).followed(slid(ALONG))
    np.testing.assert_array_equal(followed.vertices[: len(listed)], listed)
    joined = followed.vertices[len(listed) :]
    np.testing.assert_allclose(V[joined, 0], 0.75)
    assert len(joined) == 8
    np.testing.assert_allclose(
        followed.offsets["offsets"][len(listed) :], 0.2 * np.tile(np.eye(3)[1], (8, 1)), atol=1e-6
    )
    np.testing.assert_allclose(followed.offsets["offsets"][: len(listed)], offsets, atol=1e-6)


def test_offsets_of_normals_turn_with_the_surface() -> None:
    """About the axis of the tube, by the same angle for all points: corners slide to the next."""
    half = np.pi / 8
    turn = np.array([[1, 0, 0], [0, np.cos(half), np.sin(half)], [0, -np.sin(half), np.cos(half)]])
    outward = V * [0, 1, 1]
    followed = shape(normalOffsets=outward).followed(slid(V @ turn - V))
    # Half-way along a side of the octagon, offsets are as long as the side is far.
    expected = outward @ turn * np.cos(half)
    np.testing.assert_allclose(followed.offsets["normalOffsets"], expected, atol=0.02)


def test_what_did_not_slide_keeps_its_bits() -> None:
    own = shape(offsets=waving(V))
    followed = own.followed(slid(ALONG * (V[:, :1] > 1)))
    stays = V[:, 0] <= 1
    assert not np.array_equal(followed.offsets["offsets"], own.offsets["offsets"])
    np.testing.assert_array_equal(followed.offsets["offsets"][stays], own.offsets["offsets"][stays])


def waving_stage(path: Path, listed: np.ndarray | None = None) -> Rigged:
    """Write a tube that no joint moves, with a shape that bulges half-way."""
    rigged = Rigged.at(path)
    mesh = rigged.add_tube()
    rows = np.arange(len(V)) if listed is None else listed
    rigged.add_shape(mesh, waving(V)[rows], 0.3 * waving(V)[rows], WEIGHTS)
    smile = UsdSkel.BlendShape(rigged.stage.GetPrimAtPath(SMILE))
    smile.CreateNormalOffsetsAttr(Vt.Vec3fArray.FromNumpy(leaning(V)[rows].astype(np.float32)))
    if listed is not None:
        smile.CreatePointIndicesAttr(listed.tolist())
    return rigged


def planned(original: Asset) -> Asset:
    """Slide all points, and pose them by the shape of their new places."""
    P = V + ALONG

    def moved(time: float) -> np.ndarray:
        w = WEIGHTS[time]
        # Beyond the in-between, what it adds becomes what the shape adds.
        share = 0.6 * w if w <= 0.5 else 0.3 + 1.4 * (w - 0.5)
        return P + share * waving(P)

    mesh = original.meshes[0].map(lambda frame: frame.moved(moved(frame.time)))
    return replace(original, meshes=(mesh, *original.meshes[1:]))


def posed(file: Path) -> np.ndarray:
    return np.stack([frame.points for frame in read_stage(str(file)).meshes[0]])


def written(file: Path, path: str = SMILE) -> dict[str, np.ndarray]:
    """Return what the layer says of a shape."""
    layer = Sdf.Layer.FindOrOpen(str(file))
    over = layer.GetPrimAtPath(path)
    return {} if over is None else {each.name: np.array(each.default) for each in over.attributes}


@pytest.mark.parametrize("write", [write_override, write_flattened])
@pytest.mark.parametrize("some", [False, True])
def test_a_slide_is_posed_as_it_was_planned(tmp_path: Path, write, some: bool) -> None:
    listed = np.flatnonzero(V[:, 0] > 0.4) if some else None
    original = read_stage(waving_stage(tmp_path / "a.usda", listed).save())
    marked = planned(original)
    frames = np.stack([frame.points for frame in marked.meshes[0]])
    # What the plan slides in from where the shape is not is not posed by it.
    rows = V[:, 0] > (0.4 if some else -1)
    off = {}
    for primvars in ("keep", "follow"):
        output = tmp_path / f"{primvars}.usda"
        write(original, marked, output, skel="rest", primvars=primvars)
        off[primvars] = np.linalg.norm((posed(output) - frames)[:, rows], axis=2).max()
    assert off["keep"] > 5e-3
    # Between the rings, the wave is replaced by its chords.
    assert off["follow"] < 0.35 * off["keep"]
    found = written(output)
    if some and write is write_override:
        assert {"pointIndices", "offsets", "normalOffsets", "inbetweens:half"} == set(found)
    assert len({len(each) for name, each in found.items() if each.ndim > 1}) == 1
    stage = Usd.Stage.Open(str(output))
    half = UsdSkel.BlendShape(stage.GetPrimAtPath(SMILE)).GetInbetween("half")
    assert half.GetWeight() == 0.5


def test_only_shapes_that_change_are_written(tmp_path: Path) -> None:
    """A shape that moves all points alike is the same at every place."""
    rigged = Rigged.at(tmp_path / "a.usda")
    same = np.tile([0.0, 0.1, 0.0], (len(V), 1))
    rigged.add_shape(rigged.add_tube(), same, 0.5 * same, WEIGHTS)
    original = read_stage(rigged.save())
    mesh = original.meshes[0].map(lambda frame: frame.moved(frame.points + ALONG))
    write_override(original, replace(original, meshes=(mesh,)), tmp_path / "o.usda", skel="rest")
    assert written(tmp_path / "o.usda") == {}


def test_shapes_of_several_meshes_stay(tmp_path: Path) -> None:
    rigged = waving_stage(tmp_path / "a.usda")
    other = rigged.add_tube("/man/leg")
    binding = UsdSkel.BindingAPI.Apply(other.GetPrim())
    binding.CreateBlendShapesAttr(["smile"])
    binding.CreateBlendShapeTargetsRel().SetTargets([SMILE])
    original = read_stage(rigged.save())
    for write in (write_override, write_flattened):
        done = write(original, planned(original), tmp_path / "o.usda", skel="rest")
        assert done.as_json()["shared_shapes"] == [SMILE]
        shown = Usd.Stage.Open(str(tmp_path / "o.usda"))
        offsets = UsdSkel.BlendShape(shown.GetPrimAtPath(SMILE)).GetOffsetsAttr().Get()
        np.testing.assert_array_equal(np.array(offsets), waving(V).astype(np.float32))
    done = write_override(original, planned(original), tmp_path / "o.usda", skel="bake")
    assert "shared_shapes" not in done.as_json()


def test_shapes_that_do_not_fit_stay(tmp_path: Path) -> None:
    rigged = waving_stage(tmp_path / "a.usda")
    smile = UsdSkel.BlendShape(rigged.stage.GetPrimAtPath(SMILE))
    smile.CreatePointIndicesAttr([len(V), 1])
    original = read_stage(rigged.save())
    write_override(original, planned(original), tmp_path / "o.usda", skel="rest")
    assert written(tmp_path / "o.usda") == {}


def instances(folder: Path) -> str:
    """Write two instances of the tube with its shape."""
    waving_stage(folder / "a.usda").save()
    stage = Usd.Stage.CreateNew(str(folder / "two.usda"))
    for name in ("a", "b"):
        prim = stage.DefinePrim(f"/{name}")
        prim.GetReferences().AddReference("./a.usda")
        prim.SetInstanceable(True)
    stage.GetRootLayer().Save()
    return str(folder / "two.usda")


def test_instances_have_shapes_of_their_own_in_a_deliverable(tmp_path: Path) -> None:
    original = read_stage(instances(tmp_path))
    marked = planned(original)
    done = write_flattened(original, marked, tmp_path / "o.usda", skel="rest")
    assert "shared_shapes" not in done.as_json()
    found = {name: written(tmp_path / "o.usda", f"/{name}/arm/smile")["offsets"] for name in "ab"}
    np.testing.assert_array_equal(found["b"], waving(V).astype(np.float32))
    away = np.abs(found["a"] - waving(V + ALONG)).max()
    assert away < 0.35 * np.abs(found["b"] - waving(V + ALONG)).max()


def test_instances_share_shapes_that_follow(tmp_path: Path) -> None:
    original = read_stage(instances(tmp_path))
    write_override(original, planned(original), tmp_path / "o.usda", skel="rest")
    shown = Usd.Stage.Open(str(tmp_path / "o.usda"))
    assert shown.GetPrimAtPath("/a").GetPrototype() == shown.GetPrimAtPath("/b").GetPrototype()
    offsets = UsdSkel.BlendShape(shown.GetPrimAtPath("/b/arm/smile")).GetOffsetsAttr().Get()
    away = np.abs(np.array(offsets) - waving(V + ALONG)).max()
    assert away < 0.35 * np.abs(waving(V) - waving(V + ALONG)).max()


def test_shapes_that_are_others_in_other_variants_stay(tmp_path: Path) -> None:
    """Nothing shows it: the weights are 0 throughout."""
    rigged = waving_stage(tmp_path / "a.usda")
    for time in WEIGHTS:
        rigged.animation.GetBlendShapeWeightsAttr().Set(Vt.FloatArray([0.0]), time)
    smile = rigged.stage.GetPrimAtPath(SMILE)
    sets = rigged.stage.GetPrimAtPath("/man").GetVariantSets().AddVariantSet("face")
    smile.RemoveProperty("offsets")
    for name, share in (("wide", 1.0), ("narrow", 0.5)):
        sets.AddVariant(name)
        sets.SetVariantSelection(name)
        with sets.GetVariantEditContext():
            offsets = (share * waving(V)).astype(np.float32)
            UsdSkel.BlendShape(smile).CreateOffsetsAttr(Vt.Vec3fArray.FromNumpy(offsets))
    original = read_stage(rigged.save())
    mesh = original.meshes[0].map(lambda frame: frame.moved(frame.points + ALONG))
    write_override(original, replace(original, meshes=(mesh,)), tmp_path / "o.usda", skel="rest")
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "o.usda"))
    assert "points" in layer.GetPrimAtPath("/man/arm").attributes
    assert written(tmp_path / "o.usda") == {}
