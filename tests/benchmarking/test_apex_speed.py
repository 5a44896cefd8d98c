"""The benchmark of speed watches functions by their names, which must be there."""

from __future__ import annotations

from importlib import import_module
from operator import attrgetter

import pytest

import apex_speed


@pytest.mark.parametrize(
    ("module", "function"),
    sorted(
        {(module, function) for module, function, _ in apex_speed.EMBED_STAGES}
        | {(module, function) for module, function, _ in apex_speed.LOOK_STAGES}
    ),
)
def test_what_is_watched_is_a_function(module: str, function: str) -> None:
    assert callable(attrgetter(function)(import_module(module)))
