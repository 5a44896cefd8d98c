"""Recipes of several layers: their order, their common limit, and what was typed."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.errors import UsageError
from meshmark.extension.recipe import (
    Recipe,
    blind_layers,
    default_layers,
    in_order,
    layers_from_text,
    within_mrms,
)


def limits(layers) -> list[float]:
    return [layer.parameter("max_mrms") for layer in layers]


def test_blind_layers_come_first() -> None:
    relief, apex = Recipe("relief"), Recipe("apex")
    assert in_order([relief, apex]) == (apex, relief)
    assert in_order(relief) == (relief,)
    assert in_order(None) == default_layers()
    assert [layer.scheme for layer in default_layers()] == ["apex", "relief"]


def test_a_copy_alone_is_tried_with_what_embed_marks_with() -> None:
    assert blind_layers() == default_layers()[:1]


@pytest.mark.parametrize("layers", [[], [Recipe("apex"), Recipe("apex")]])
def test_no_layer_and_the_same_one_twice_are_refused(layers) -> None:
    with pytest.raises(UsageError, match="a scheme of its own"):
        in_order(layers)


def test_the_squares_of_the_layers_limits_sum_up_to_the_common_one() -> None:
    bare = [Recipe("apex"), Recipe("relief")]
    for limit in (1e-5, 2e-4):
        shared = limits(within_mrms(bare, limit))
        assert np.hypot(*shared) == pytest.approx(limit)
        assert shared[0] / shared[1] == pytest.approx(limits(bare)[0] / limits(bare)[1])
    # The first layer's own holds for all where nobody says otherwise.
    assert np.hypot(*limits(default_layers())) == pytest.approx(limits(bare)[0])


def test_a_scheme_without_a_limit_cannot_be_within_one() -> None:
    layers = [Recipe("cho2007"), Recipe("relief")]
    assert within_mrms(layers) == tuple(layers)
    with pytest.raises(UsageError, match="cho2007 has no limit"):
        within_mrms(layers, 1e-4)


def test_settings_are_of_the_first_scheme_or_of_whose_name_they_have() -> None:
    apex, relief = layers_from_text(["apex", "relief"], settings=["words=4", "relief.slope=0.2"])
    assert (apex.parameter("words"), relief.parameter("slope")) == (4, 0.2)
    [alone] = layers_from_text(["relief"], settings=["slope=0.2"], max_mrms=5e-5)
    assert (alone.parameter("slope"), alone.parameter("max_mrms")) == (0.2, 5e-5)
    both = layers_from_text(["relief", "apex"], strength=None, max_mrms=1e-4)
    assert [layer.scheme for layer in both] == ["apex", "relief"]
    assert np.hypot(*limits(both)) == pytest.approx(1e-4)


@pytest.mark.parametrize(
    ("schemes", "settings", "message"),
    [
        (["apex", "apex"], [], "a scheme of its own"),
        (["apex", "relief"], ["slope=0.2"], "slope"),
        (["apex", "relief"], ["relief.words=4"], "words"),
        (["apex"], ["relief.slope=0.2"], "relief"),
        (["apex", "nothing"], [], "nothing"),
        (["apex", "relief"], ["relief.slope=steep"], "slope"),
    ],
)
def test_what_was_mistyped_is_told(schemes, settings, message) -> None:
    with pytest.raises(UsageError, match=message):
        layers_from_text(schemes, settings=settings)
