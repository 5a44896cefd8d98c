"""Parameters from text: one way to parse them, one way to refuse them."""

from __future__ import annotations

import pytest

from meshmark.errors import UsageError
from meshmark.extension.parameters import name_and_parameters, name_and_value, require_known


def test_only_the_first_sign_of_equality_parts_a_name_from_its_value() -> None:
    assert name_and_value("attacks=noise:amplitude=1", "no") == ("attacks", "noise:amplitude=1")
    assert name_and_value("label=", "no") == ("label", "")
    with pytest.raises(UsageError, match="takes NAME=VALUE"):
        name_and_value("label", "takes NAME=VALUE")


def test_semicolons_stand_for_commas_in_the_values_of_a_step() -> None:
    text = " scale:factors=1;1.2;1, strength = 0.1 "
    expected = {"factors": "1,1.2,1", "strength": "0.1"}
    assert name_and_parameters(text, str) == ("scale", expected)
    assert name_and_parameters("reverse", str) == ("reverse", {})
    assert name_and_parameters("noise:,", str) == ("noise", {})
    with pytest.raises(UsageError, match="'loud' is wrong"):
        name_and_parameters("noise:kind=uniform,loud", lambda pair: f"{pair!r} is wrong")


def test_what_is_not_known_is_refused_with_what_is() -> None:
    require_known("segmenter sdf", ["rays", "cone"], ["cone"])
    with pytest.raises(UsageError, match="segmenter sdf has no parameter 'x'; it takes: cone, ray"):
        require_known("segmenter sdf", ["rays", "cone"], ["rays", "x"])
    with pytest.raises(UsageError, match="it takes: none"):
        require_known("geodesic exact", [], ["x"])
