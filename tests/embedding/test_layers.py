"""Layers of a mark: the owner's blind word in every copy, the recipient's beside the original."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import numpy as np
import pytest

from meshmark import verify
from meshmark.demo import creature
from meshmark.detection.verdict import Verdict
from meshmark.embedding import layers
from meshmark.embedding.asset import MarkedAsset, embed
from meshmark.embedding.file import mark_file
from meshmark.errors import CapacityError, InputError, UsageError
from meshmark.extension.recipe import Recipe, default_layers
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.metrics import distortion
from meshmark.sources.writing import writer
from meshmark.testing.meshes import icosphere
from meshmark_plugins.schemes.relief.scheme import Relief
from rigged_stages import bent_tube

KEY = Key(bytes(range(32)))
APEX, RELIEF = Recipe("apex"), Recipe("relief")
NAMES = ["acme", "bob", "carol"]


@pytest.fixture(scope="module")
def original() -> MeshAnimation:
    return creature(points=3000, frames=1)


@pytest.fixture(scope="module")
def copies(original) -> dict[str, MarkedAsset]:
    # Given in the other order, which changes nothing.
    both = default_layers()
    return {
        name: embed(original, KEY, recipe=recipe, recipient=name)
        for name, recipe in (("acme", both), ("bob", both[::-1]))
    }


@pytest.fixture
def ball() -> MeshAnimation:
    return MeshAnimation.from_arrays(*icosphere(3))


def points(asset) -> np.ndarray:
    return asset.meshes[0][0].points


def mrms(marked: MarkedAsset) -> float:
    [mesh] = marked.meshes
    return distortion(mesh.original, mesh.animation).mrms_rel


def test_marking_that_fails_leaves_no_thread(original, monkeypatch) -> None:
    """One that ran on could crash the process as it exits."""
    began = threading.Event()

    def endless(*_) -> None:
        began.set()
        while True:
            time.sleep(0.01)

    def fail(*_, **__) -> None:
        assert began.wait(10.0)
        raise InputError("unfit")

    monkeypatch.setattr(Relief, "layout", endless)
    monkeypatch.setattr(layers, "embed_animation", fail)
    with pytest.raises(InputError, match="unfit"):
        embed(original, KEY, recipe=default_layers(), jobs=2)
    assert "meshmark-beside" not in [thread.name for thread in threading.enumerate()]


def test_the_blind_layer_is_the_same_in_all_copies(copies) -> None:
    one, two = copies["acme"], copies["bob"]
    np.testing.assert_array_equal(points(one.master), points(two.master))
    assert np.any(points(one.asset) != points(two.asset))
    assert [layer.scheme for layer in one.meshes[0].layers] == ["apex", "relief"]
    assert [layer.informed for layer in one.meshes[0].layers] == [False, True]


def test_the_blind_layer_names_the_owner_and_nobody_else(copies) -> None:
    found = verify(copies["acme"].asset, KEY, recipes=[APEX], recipients=NAMES)
    assert found.verdict == "marked"
    assert found.recipient is None
    assert [named.recipient for named in found.recipients] == [None]


def test_averages_of_copies_keep_the_owner(original, copies) -> None:
    mean = sum(points(copy.asset) for copy in copies.values()) / len(copies)
    averaged = original.map(lambda frame: frame.moved(mean))
    assert verify(averaged, KEY, recipes=[APEX]).verdict == "marked"
    # With the original, both who averaged are named.
    master = copies["acme"].master
    beside = verify(averaged, KEY, recipients=NAMES, original=original, master=master)
    assert {named.recipient for named in beside.recipients} >= {"acme", "bob"}
    assert "carol" not in {named.recipient for named in beside.recipients}


@pytest.fixture(scope="module")
def beside_master(original, copies) -> Verdict:
    copy = copies["acme"]
    return verify(copy.asset, KEY, recipients=NAMES, original=original, master=copy.master)


def test_the_recipient_is_named_beside_the_original(beside_master) -> None:
    assert (beside_master.verdict, beside_master.recipient) == ("marked", "acme")
    assert {named.recipient for named in beside_master.recipients} <= {"acme", None}
    [prim] = beside_master.prims
    assert prim.scheme == "relief"
    assert prim.informed is not None
    assert prim.informed.facts.method == "identity"


@pytest.mark.slow
def test_beside_its_master_a_copy_tells_more(original, copies, beside_master) -> None:
    made = []

    def master():
        made.append(True)
        return copies["acme"].master

    asset, asked = copies["acme"].asset, {"recipients": NAMES, "original": original}
    alone = verify(asset, KEY, recipes=[RELIEF], master=master, **asked)
    assert (alone.verdict, alone.recipient) == ("marked", "acme")
    assert beside_master.log10_p < alone.log10_p - 50
    # The original decided; nobody made a master then.
    assert not made
    other = verify(asset, Key(bytes(range(1, 33))), recipes=[RELIEF], master=master, **asked)
    assert other.verdict == "not marked"
    assert made


def test_an_unmarked_copy_is_not_marked(original) -> None:
    noise = 1e-4 * np.random.default_rng(0).normal(size=(original[0].topology.n_points, 3))
    copy = original.map(lambda frame: frame.moved(frame.points + noise))
    found = verify(copy, KEY, recipes=[APEX, RELIEF], recipients=NAMES, original=original)
    assert found.verdict == "not marked"
    assert found.log10_p > -2
    assert found.recipients == ()


def test_a_blind_layer_alone_names_the_recipient(original) -> None:
    copy = embed(original, KEY, recipe=APEX, recipient="acme")
    found = verify(copy.asset, KEY, recipes=[APEX], recipients=NAMES)
    assert (found.verdict, found.recipient) == ("marked", "acme")


def test_an_informed_layer_alone_needs_no_master(ball) -> None:
    copy = embed(ball, KEY, recipe=RELIEF, recipient="acme")
    np.testing.assert_array_equal(points(copy.master), ball[0].points)
    assert copy.meshes[0].missing == ()


def test_what_a_mesh_cannot_hold_is_told(ball) -> None:
    [mesh] = embed(ball, KEY).meshes
    assert [layer.scheme for layer in mesh.layers] == ["relief"]
    [(scheme, reason)] = mesh.missing
    assert scheme == "apex"
    assert reason
    np.testing.assert_array_equal(mesh.master[0].points, ball[0].points)


def test_the_default_limit_is_kept(copies) -> None:
    assert mrms(copies["acme"]) <= APEX.parameter("max_mrms")


def test_an_informed_scheme_wants_an_original_and_blind_ones_have_no_use_for_it(ball) -> None:
    with pytest.raises(UsageError, match="beside its original only"):
        verify(ball, KEY, recipes=[RELIEF])
    with pytest.raises(UsageError, match="no use of an original"):
        verify(ball, KEY, recipes=[APEX], original=ball)


@pytest.mark.parametrize(
    ("skel", "primvars", "written"),
    [("rest", "follow", "follow"), ("rest", "keep", "keep"), ("bake", "follow", "keep")],
)
def test_the_master_of_a_rest_pose_is_posed_like_the_copy(
    tmp_path: Path, monkeypatch, skel: str, primvars: str, written: str
) -> None:
    """What nobody poses holds no more than points: the tube itself can hold no mark."""
    asked = []

    def noted(original, output, **how):
        asked.append((Path(output).name, how["skel"], how["primvars"]))
        return writer(original, output, **how)

    for module in ("file", "outputs"):
        monkeypatch.setattr(f"meshmark.embedding.{module}.writer", noted)
    source, master = bent_tube(tmp_path / "a.usda"), tmp_path / "master.usda"
    with pytest.raises(CapacityError):
        mark_file(source, tmp_path / "o.usda", KEY, skel=skel, primvars=primvars, master=master)
    assert asked == [("o.usda", skel, primvars), ("master.usda", skel, written)]
