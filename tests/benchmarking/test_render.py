from __future__ import annotations

import numpy as np
import pytest

from meshmark.errors import UsageError
from render import View, render_frame

SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def test_a_square_covers_what_it_should() -> None:
    view = View(azimuth=0, elevation=0, center=(0, 0, 0), span=4)
    picture = render_frame(SQUARE, FACES, view=view, size=(80, 40), samples=1)
    assert picture.shape == (40, 80, 3)
    covered = np.any(picture < 250, axis=2)
    assert np.array_equal(np.flatnonzero(covered.any(axis=0)), np.arange(20, 60))
    assert covered.all(axis=0).sum() == 40


def test_faces_have_their_colours_seen_from_either_side() -> None:
    colors = np.array([[0.9, 0.0, 0.0], [0.0, 0.0, 0.9]])
    for azimuth, right in ((0, 0), (180, 2)):
        view = View(azimuth=azimuth, elevation=0, center=(0, 0, 0), span=4)
        picture = render_frame(SQUARE, FACES, colors=colors, view=view, size=(40, 40), samples=1)
        # The first face is the lower right half, seen from the front.
        pixel = picture[25, 26] if azimuth == 0 else picture[14, 26]
        assert pixel.argmax() == right
        assert np.sort(pixel)[1] == 0


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
def test_the_up_axis_is_up(up_axis: str) -> None:
    axes = View(azimuth=30, elevation=20, up_axis=up_axis).axes()
    up = np.array([0, 0, 1.0]) if up_axis == "Z" else np.array([0, 1.0, 0])
    assert np.allclose(axes @ axes.T, np.eye(3))
    assert np.linalg.det(axes) == pytest.approx(1)
    assert axes[0] @ up == pytest.approx(0)
    assert axes[1] @ up == pytest.approx(np.cos(np.radians(20)))


def test_equal_input_gives_equal_pictures() -> None:
    assert np.array_equal(*(render_frame(SQUARE, FACES, size=(60, 40)) for _ in range(2)))


def test_bad_requests_are_refused() -> None:
    with pytest.raises(UsageError, match="one for each face"):
        render_frame(SQUARE, FACES, colors=np.zeros((3, 3)))
    with pytest.raises(UsageError, match="positive size"):
        render_frame(SQUARE, FACES, size=(0, 10))
