"""The built-in schemes by the suite that third parties' schemes are held to."""

from __future__ import annotations

import pytest

from meshmark.plugins import catalogue
from meshmark.recipe import DEFAULT_GEODESIC, DEFAULT_SEGMENTER, Recipe, SolverFactory
from meshmark.testing import SchemeSuite


class BuiltInSuite(SchemeSuite):
    """A scheme by its name, with the default segmenter and solver."""

    name: str

    @pytest.fixture
    def scheme(self):
        return Recipe(self.name).build()

    @pytest.fixture
    def record(self):
        return catalogue().find("scheme", self.name).record

    @pytest.fixture
    def parts(self):
        segmenter = catalogue().make("segmenter", DEFAULT_SEGMENTER)
        return {"segmenter": segmenter, "solver": SolverFactory(DEFAULT_GEODESIC, {})}


class TestTsai2014(BuiltInSuite):
    name = "tsai2014"
