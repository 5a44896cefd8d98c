"""What the suites of all kinds of schemes share: the record, and how a mark is found."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from meshmark.detection.extraction import extract
from meshmark.detection.significance import judge
from meshmark.embedding.mesh import Embedded, embed_animation
from meshmark.extension.hookspecs import HELPERS, BinnedScheme, Scheme, SchemeRecord
from meshmark.extension.informed import InformedScheme
from meshmark.keys import Key
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.testing.meshes import Mesh

NAME = "scheme-under-test"
KEY, OTHER = Key(bytes(range(32))), Key(bytes(range(1, 33)))
# Log10 p that a key which marked nothing stays above: the suites' keys are always the same.
CHANCE = -3.0


class AnySchemeSuite:
    """Checks what schemes of all kinds have in common."""

    @pytest.fixture
    def scheme(self) -> Scheme | BinnedScheme | InformedScheme:
        """Offer the scheme under test."""
        raise NotImplementedError("override the fixture `scheme`")

    @pytest.fixture
    def record(self) -> SchemeRecord | None:
        """Offer the record of the scheme; None leaves out the tests of it."""
        return None

    @pytest.fixture
    def parts(self) -> dict[str, Any]:
        """Offer a `segmenter` and a `solver`; the record's factory gets those that it needs."""
        return {"segmenter": None, "solver": None}

    @pytest.fixture
    def tolerance(self) -> float:
        """Difference allowed to what is measured where only rounding differs."""
        return 1e-6

    def test_record_is_complete(self, record: SchemeRecord | None) -> None:
        """A record names its scheme, says in one line what it does, and has a version."""
        if record is None:
            pytest.skip("no record is offered")
        assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", record.name)
        assert record.summary.strip()
        assert "\n" not in record.summary
        assert record.version


class PlanningSchemeSuite(AnySchemeSuite):
    """Checks what schemes have in common that mark an animation by one plan."""

    @pytest.fixture
    def highest_log10_p(self) -> float:
        """Log10 p that the key's own mark must come below."""
        return -6.0

    def test_another_key_another_mark(
        self, scheme: Scheme | InformedScheme, animation: MeshAnimation
    ) -> None:
        """Marks tell their keys, and the copies of different recipients, apart."""
        single = animation.select([0])
        one, two, three = (
            embed_animation(single, scheme, NAME, key, recipient=recipient).animation[0].points
            for key, recipient in ((KEY, None), (OTHER, None), (KEY, "somebody else"))
        )
        assert np.any(one != two)
        assert np.any(one != three)

    def test_equal_keys_give_equal_marks_by_any_number_of_workers(
        self, scheme: Scheme | InformedScheme, animation: MeshAnimation
    ) -> None:
        """Nothing but the key and the animation decides, to the last bit."""
        one, two = (
            embed_animation(animation, scheme, NAME, KEY, jobs=jobs).animation for jobs in (1, 2)
        )
        for alone, shared in zip(one, two, strict=True):
            np.testing.assert_array_equal(alone.points, shared.points)


def needed(record: SchemeRecord, parts: dict[str, Any]) -> dict[str, Any]:
    """Return the parts that a record's factory is called with."""
    assert set(record.needs) <= set(HELPERS)
    return {name: parts[name] for name in record.needs}


def assert_found_blindly(
    scheme: Scheme, animation: MeshAnimation, highest_log10_p: float
) -> Embedded:
    """Fail unless a mark is found without the original, by its key alone, and return it.

    It goes through float32, which leaves the topology as it was and moves every frame.
    """
    embedded = embed_animation(animation, scheme, NAME, KEY)
    leaked = embedded.animation.map(rounded)
    assert_moved(animation, leaked)
    evidence = extract(leaked, scheme, NAME)
    assert judge(evidence, KEY).log10_p < highest_log10_p
    assert judge(evidence, OTHER).log10_p > CHANCE
    assert judge(evidence, KEY, "somebody else").log10_p > CHANCE
    assert judge(extract(animation, scheme, NAME), KEY).log10_p > CHANCE
    return embedded


def assert_moved(animation: MeshAnimation, leaked: MeshAnimation) -> None:
    """Fail unless every frame has the faces it had, and vertices in other places."""
    for before, after in zip(animation, leaked, strict=True):
        assert after.topology.same_as(before.topology)
        assert np.all(np.isfinite(after.points))
        assert np.any(after.points != before.points.astype(np.float32))


def rounded(frame: Frame) -> Frame:
    """Round a frame's points to float32, as any file would."""
    return frame.moved(frame.points.astype(np.float32).astype(np.float64))


def tetrahedron() -> Mesh:
    """Build a mesh without room for any mark."""
    V = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.2]])
    return V, np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
