"""Informed evidence: what is read beside what, and what is refused or left open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshmark import verify
from meshmark.commands.attack import write_attacked
from meshmark.detection.decision import decide
from meshmark.detection.evidence_cache import EvidenceFile, kept_evidence
from meshmark.detection.informed import gather_informed
from meshmark.detection.significance import VERTEX_SHARE, judge, log10_p_of, log10_p_of_names
from meshmark.detection.verify import judge_all
from meshmark.embedding.asset import embed
from meshmark.errors import CapacityError, UsageError
from meshmark.extension.recipe import Recipe
from meshmark.extension.registry import catalogue
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset, as_asset
from meshmark.testing.informed_schemes import horned
from meshmark.testing.meshes import bent_tube, icosphere, torus

KEY, OTHER = Key(bytes(range(32))), Key(bytes(range(1, 33)))
RELIEF = [Recipe("relief")]


def mesh(shape, prim="/A", shift=0.0) -> MeshAnimation:
    V, F = shape
    return MeshAnimation.from_arrays(V + shift, F, prim=prim)


@pytest.fixture(scope="module")
def copy() -> Asset:
    return embed(horned(), KEY, recipe=RELIEF).asset


NAMES = ["acme", "birch", "cedar"]


@pytest.fixture(scope="module")
def patchwork() -> Asset:
    """Copies of three recipients made into one: each vertex from one of them, at random."""
    first, *others = (
        embed(horned(), KEY, recipe=RELIEF, recipient=name).asset.meshes[0] for name in NAMES
    )
    blend = catalogue().make("attack", "collusion", other=tuple(others), kind="choice")
    return as_asset(blend.apply(first, np.random.default_rng(1)))


def asset(*meshes: MeshAnimation) -> Asset:
    return Asset("several.usda", meshes, "memory")


def test_evidence_tells_how_the_copy_lies(copy) -> None:
    [item] = gather_informed(copy, as_asset(horned()), RELIEF).items
    facts = item.informed
    assert facts is not None
    assert (facts.prim, facts.method, facts.poses) == ("/Horns", "identity", (0.0, 1.0, 2.0))
    assert facts.covered > 0.99
    assert facts.residual < 2e-4
    assert 0 < facts.patches <= item.n_chips
    assert judge(item, KEY).log10_p < -20


def test_a_copy_written_just_now_is_read_where_it_was_written(copy) -> None:
    original = as_asset(horned())
    [item] = gather_informed(copy, original, RELIEF, points_in_place=np.inf).items
    facts = item.informed
    assert facts is not None
    assert (facts.method, facts.poses, facts.maps) == (
        "identity",
        (0.0, 1.0, 2.0),
        ("similarity",),
    )
    found, other = judge(item, KEY), judge(item, OTHER)
    assert found.log10_p < -20
    assert other.log10_p > -2
    [searched] = gather_informed(copy, original, RELIEF).items
    assert found.log10_p < 0.8 * judge(searched, KEY).log10_p
    [bare] = gather_informed(original, original, RELIEF, points_in_place=np.inf).items
    assert judge(bare, KEY).log10_p > -2


def test_what_does_not_stand_where_it_was_written_is_looked_for(copy) -> None:
    moved = as_asset(copy.meshes[0].map(lambda frame: frame.moved(frame.points + 1.0)))
    [item] = gather_informed(moved, as_asset(horned()), RELIEF, points_in_place=np.inf).items
    assert item.informed is not None
    assert "affine" in item.informed.maps
    assert judge(item, KEY).log10_p < -20


@pytest.mark.slow
def test_a_copy_of_something_else_is_inconclusive() -> None:
    tube = as_asset(mesh(bent_tube(24, 40)))
    found = gather_informed(tube, as_asset(horned().select([0])), RELIEF)
    assert found.items == ()
    [note] = found.notes
    assert "/Horns" in note
    for key in (KEY, OTHER):
        verdict = decide("tube.usda", found.items, key, notes=found.notes)
        assert (verdict.verdict, verdict.log10_p) == ("inconclusive", 0.0)
        assert verdict.notes == found.notes


def test_an_original_too_small_is_noted_not_judged() -> None:
    small = mesh(icosphere(1))
    found = gather_informed(as_asset(small), as_asset(small), RELIEF)
    assert found.items == ()
    assert "chips" in " ".join(found.notes)
    assert verify(small, KEY, recipes=RELIEF, original=small).verdict == "inconclusive"


def test_another_key_and_the_original_itself_are_not_marked(copy) -> None:
    assert verify(copy, KEY, recipes=RELIEF, original=horned()).verdict == "marked"
    assert verify(copy, OTHER, recipes=RELIEF, original=horned()).verdict == "not marked"
    noise = 1e-4 * np.random.default_rng(0).normal(size=(horned()[0].topology.n_points, 3))
    bare = horned().map(lambda frame: frame.moved(frame.points + noise))
    assert verify(bare, KEY, recipes=RELIEF, original=horned()).verdict == "not marked"


def test_what_decides_before_the_copy_was_read_alone_is_corrected_for_that_look(copy) -> None:
    """Apex finds nothing to look at on so few points, but it would have been asked."""
    both = [Recipe("apex"), *RELIEF]
    alone = verify(copy, KEY, recipes=RELIEF, original=horned())
    found = verify(copy, KEY, recipes=both, original=horned())
    assert found.verdict == "marked"
    assert found.log10_p == pytest.approx(alone.log10_p + np.log10(3.0))
    assert found.recipients[0].log10_p == pytest.approx(alone.recipients[0].log10_p + np.log10(3.0))
    assert found.prims[0].informed.log10_p == alone.log10_p
    assert found.original == alone.original


def test_every_mesh_of_the_original_is_read_where_it_lies() -> None:
    torus_, tube = mesh(torus(40, 20), "/Torus"), mesh(bent_tube(24, 40), "/Tube", 3.0)
    marked = embed(asset(torus_, tube), KEY, recipe=RELIEF).asset
    turned = asset(*marked.meshes[::-1])
    verdict = verify(turned, KEY, recipes=RELIEF, original=asset(torus_, tube))
    assert verdict.verdict == "marked"
    facts = {prim.prim: prim.informed.facts.prim for prim in verdict.prims if prim.informed}
    assert facts == {"/Torus": "/Torus", "/Tube": "/Tube"}
    assert [(each.scheme, each.meshes) for each in verdict.pooled] == [("relief", 2)]
    assert verdict.pooled[0].log10_p < -20


def test_a_master_must_be_made_from_the_original(copy) -> None:
    original = as_asset(horned())
    frames = as_asset(horned().select([0, 1]))
    other_faces = as_asset(mesh(icosphere(2), "/Horns"))
    for wrong in (frames, other_faces):
        with pytest.raises(UsageError, match="the master has other frames or faces"):
            gather_informed(copy, original, RELIEF, master=wrong)
    elsewhere = as_asset(replace(horned(), prim="/Elsewhere"))
    with pytest.raises(UsageError, match="the master has no mesh of the original"):
        gather_informed(copy, original, RELIEF, master=elsewhere)
    assert gather_informed(copy, original, RELIEF, master=original).items


def test_an_original_without_a_master_is_enough() -> None:
    ball = as_asset(mesh(icosphere(3)))
    copy = embed(ball, KEY, recipe=RELIEF).asset

    def no_master() -> Asset:
        # What `embed` says of a mesh without tips.
        return embed(ball, OTHER, recipe=[Recipe("apex")]).asset

    with pytest.raises(CapacityError):
        no_master()
    for key, wanted in ((KEY, "marked"), (OTHER, "not marked")):
        found = verify(copy, key, recipes=RELIEF, original=ball, master=no_master)
        assert found.verdict == wanted
        assert (found.recipient, found.notes) == (None, ())


def test_a_copy_is_compared_with_the_master_where_there_is_one(copy) -> None:
    original = as_asset(horned())
    alone, beside = (
        gather_informed(copy, original, RELIEF, master=master).items[0] for master in (None, copy)
    )
    assert np.exp(alone.variants[0].log_prior).sum() == pytest.approx(1.0)
    assert judge(alone, KEY).log10_p < -6.0
    # Nothing stands above itself.
    assert judge(beside, KEY).log10_p > -2.0


def test_all_who_gave_vertices_to_a_copy_are_named_and_nobody_else(patchwork) -> None:
    """Chips tell of some of them at best."""
    [item] = gather_informed(patchwork, as_asset(horned()), RELIEF).items
    names = [None, *NAMES, "dogwood", "elm"]
    chips = log10_p_of(item, KEY.words_of("relief", 1, item.n_chips, names))
    found = log10_p_of_names(item, KEY, names)
    assert chips[1:4].max() > -2.0
    assert found[1:4].max() < -8.0
    assert found[4:].min() > -2.0
    assert found[0] == chips[0]
    assert log10_p_of_names(item, OTHER, names).min() > -2.0
    verdict = decide("leak.usda", [item], KEY, recipients=[*NAMES, "dogwood", "elm"])
    assert {named.recipient for named in verdict.recipients} >= set(NAMES)
    assert {named.recipient for named in verdict.recipients} <= {None, *NAMES}


@pytest.mark.slow
def test_of_one_recipients_copy_vertices_tell_nothing_that_chips_do_not() -> None:
    named = embed(horned(), KEY, recipe=RELIEF, recipient="acme").asset
    [item] = gather_informed(named, as_asset(horned()), RELIEF).items
    chips = log10_p_of(item, KEY.words_of("relief", 1, item.n_chips, ["acme"]))
    assert chips[0] < -20.0
    paid = chips - np.log10(1.0 - VERTEX_SHARE)
    assert log10_p_of_names(item, KEY, ["acme"]) == pytest.approx(paid)


@pytest.mark.slow
def test_evidence_from_a_file_names_whom_evidence_measured_just_now_does(
    patchwork, tmp_path
) -> None:
    write_attacked(patchwork, tmp_path / "leak.usdc")
    write_attacked(as_asset(horned()), tmp_path / "original.usdc")

    def judged():
        found = kept_evidence(
            str(tmp_path / "leak.usdc"),
            EvidenceFile(tmp_path / "evidence"),
            recipes=RELIEF,
            original=str(tmp_path / "original.usdc"),
        )
        return judge_all(found, KEY, recipients=NAMES)

    measured, kept = judged(), judged()
    assert {named.recipient for named in measured.recipients} >= set(NAMES)
    assert kept.recipients == measured.recipients
    assert kept.log10_p == measured.log10_p
