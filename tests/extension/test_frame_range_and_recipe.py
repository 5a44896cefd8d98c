from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshmark.errors import UsageError
from meshmark.extension.recipe import Recipe, recipe_from_text
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.frame_range import frames_in, in_range

TRIANGLE = (np.eye(3), np.array([[0, 1, 2]]))


def animation(times) -> MeshAnimation:
    points, faces = TRIANGLE
    return MeshAnimation.from_arrays(np.tile(points, (len(times), 1, 1)), faces, times=times)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (None, [0, 1, 2, 3, 4]),
        ("auto", [0, 1, 2, 3, 4]),
        ("101:103", [0, 1, 2]),
        ("102:", [1, 2, 3, 4]),
        (":102.5", [0, 1]),
        ("101:105:2", [0, 2, 4]),
    ],
)
def test_ranges_include_both_ends(text, expected) -> None:
    assert list(frames_in(animation([101.0, 102, 103, 104, 105]), text)) == expected


@pytest.mark.parametrize("text", ["7", "a:b", "3:1", "1:5:0", "1:5:-1", "1:2:3:4", "1:5:0.5"])
def test_what_is_no_range_is_refused(text) -> None:
    with pytest.raises(UsageError, match="A:B"):
        frames_in(animation([1.0, 2.0, 3.0]), text)


@pytest.mark.parametrize("text", [None, ":", "1:1", "50:60:3"])
def test_a_mesh_without_time_is_in_every_range(text) -> None:
    assert frames_in(animation([np.nan]), text) == (0,)


def test_meshes_beyond_the_range_are_left_out_while_others_are_in_it() -> None:
    early, late, still = (
        replace(animation(times), prim=prim)
        for prim, times in {"/early": [1.0, 2.0], "/late": [8.0, 9.0], "/still": [np.nan]}.items()
    )
    asset = Asset("x", (early, late, still), "memory")
    kept, left_out = in_range(asset, "1:5")
    assert [mesh.prim for mesh in kept.meshes] == ["/early", "/still"]
    assert [each.prim for each in left_out] == ["/late"]
    assert "no frame lies in 1:5" in left_out[0].reason
    with pytest.raises(UsageError, match="/early: no frame lies in 4:5"):
        in_range(replace(asset, meshes=(early, late)), "4:5")


def test_an_empty_range_says_what_there_is() -> None:
    with pytest.raises(UsageError, match=r"there are 3, from 1 to 3"):
        frames_in(animation([1.0, 2.0, 3.0]), "10:20")


def test_settings_go_to_their_plugins_with_their_types() -> None:
    recipe = recipe_from_text("tsai2014", settings=["bits=24", "sdf.rays=9"], own={"strength": 0.1})
    assert recipe.settings == {"tsai2014": {"bits": 24, "strength": 0.1}, "sdf": {"rays": 9}}
    scheme = recipe.build()
    assert (scheme.n_chips, scheme.binned.strength) == (24, 0.1)
    recorded = recipe.as_json()
    assert recorded["scheme"]["parameters"]["bits"] == 24
    assert recorded["scheme"]["parameters"]["propagate"] == "adapt"
    assert recorded["segmenter"]["parameters"]["rays"] == 9


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (["bits"], "NAME=VALUE"),
        (["bits=many"], "takes a value like 16"),
        (["colour=red"], "has no parameter 'colour'; it takes: bits"),
        (["dijkstra.rays=3"], "only tsai2014, sdf, heat are in use"),
    ],
)
def test_bad_settings_say_what_would_be_good(settings, message) -> None:
    with pytest.raises(UsageError, match=message):
        recipe_from_text("tsai2014", settings=settings)


@pytest.mark.parametrize(
    ("name", "value"),
    [("bits", 1), ("strength", 0.5), ("words", 13), ("propagate", "teleport"), ("step", 0.0)],
)
def test_impossible_values_are_refused(name, value) -> None:
    with pytest.raises(UsageError, match=name):
        Recipe("tsai2014", settings={"tsai2014": {name: value}}).build()


def test_impossible_values_of_what_a_scheme_does_not_need_are_refused_too() -> None:
    with pytest.raises(UsageError, match="rays"):
        Recipe("apex", settings={"sdf": {"rays": 0}}).build()


def test_only_what_a_scheme_needs_is_made(monkeypatch) -> None:
    made: list[str] = []
    build = Recipe.build_segmenter
    monkeypatch.setattr(
        Recipe, "build_segmenter", lambda self: made.append(self.scheme) or build(self)
    )
    for name in ("apex", "cho2007", "tsai2014"):
        Recipe(name).build()
    assert made == ["tsai2014"]


def test_unknown_names_list_the_known() -> None:
    with pytest.raises(UsageError, match=r"known are: .*tsai2014"):
        Recipe("tsai2015")
