"""What a thread works out beside its process."""

from __future__ import annotations

import threading
import time
from concurrent.futures import CancelledError

import numpy as np
import pytest

from meshmark.demo import creature
from meshmark.detection.original_layout import OriginalLayout
from meshmark.errors import CapacityError
from meshmark.extension.recipe import Recipe
from meshmark.mesh.animation import MeshAnimation
from meshmark.workers.beside import Beside


def test_a_thread_works_until_somebody_asks():
    asked = threading.Event()

    def work() -> int:
        assert asked.wait(10.0)
        return threading.get_ident()

    beside = Beside(work)
    asked.set()
    assert beside.result() != threading.get_ident()
    beside.end()


def test_what_goes_wrong_in_it_is_raised_where_somebody_asks():
    with pytest.raises(ZeroDivisionError):
        Beside(lambda: 1 // 0).result()


def test_what_nobody_asks_for_is_ended():
    began, seen = threading.Event(), []

    def work() -> None:
        began.set()
        try:
            for _ in range(6_000):
                time.sleep(0.01)
        finally:
            seen.append("tidied")

    beside = Beside(work)
    assert began.wait(10.0)
    beside.end()
    assert seen == ["tidied"]
    with pytest.raises(CancelledError):
        beside.result()


def test_a_layout_that_was_begun_is_the_same():
    scheme, animation = Recipe("relief").build(), creature(frames=1)
    begun, plain = OriginalLayout(animation, scheme), OriginalLayout(animation, scheme)
    begun.begin()
    w = np.random.default_rng(0).choice((-1.0, 1.0), plain.layout.n_chips)
    np.testing.assert_array_equal(begun.layout.basis.heights(w), plain.layout.basis.heights(w))
    assert begun.layout.height == plain.layout.height


def test_a_layout_that_cannot_be_says_so_when_it_is_asked_for():
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    two = np.array([[0, 1, 2], [0, 2, 3]])
    layout = OriginalLayout(MeshAnimation.from_arrays(square, two), Recipe("relief").build())
    layout.begin()
    with pytest.raises(CapacityError, match="4 points have room"):
        assert layout.layout
