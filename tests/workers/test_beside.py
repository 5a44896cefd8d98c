"""What a thread works out beside its process."""

from __future__ import annotations

import subprocess
import sys
import threading

import numpy as np
import pytest

from meshmark.demo import creature
from meshmark.detection.original_layout import OriginalLayout
from meshmark.errors import CapacityError
from meshmark.extension.recipe import Recipe
from meshmark.mesh.animation import MeshAnimation
from meshmark.workers.beside import begin_beside


def test_a_thread_works_until_somebody_asks():
    asked = threading.Event()

    def work() -> int:
        assert asked.wait(10.0)
        return threading.get_ident()

    future = begin_beside(work)
    assert not future.done()
    asked.set()
    assert future.result(10.0) != threading.get_ident()


def test_what_goes_wrong_in_it_is_raised_where_somebody_asks():
    with pytest.raises(ZeroDivisionError):
        begin_beside(lambda: 1 // 0).result(10.0)


def test_a_process_does_not_wait_for_what_nobody_asks_for():
    program = (
        "import time; from meshmark.workers.beside import begin_beside;"
        "begin_beside(lambda: time.sleep(60)); print('over')"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, timeout=30)
    assert (done.returncode, done.stdout.split(), done.stderr) == (0, [b"over"], b"")


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
