"""The whole scheme: words that are read, what is refused, parameters, and frozen numbers."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.errors import CapacityError, UsageError
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.testing.meshes import bumpy_sphere, capsule, icosphere, plane, torus
from meshmark.workers.scratch import DOUBLE, ScratchFile
from meshmark_plugins.schemes.apex.anchors.components import reference_root_area
from meshmark_plugins.schemes.apex.anchors.track import FrameAnchors
from meshmark_plugins.schemes.apex.chips.scale_hypotheses import OFFSETS, ScaleHypotheses
from meshmark_plugins.schemes.apex.chips.unit_series import nearest_residue, relative_units
from meshmark_plugins.schemes.apex.marking.plan import require_capacity
from meshmark_plugins.schemes.apex.scheme import Apex

HORNS = np.array(
    [[1, 0.2, 0.1], [-0.3, 1, 0.2], [-0.6, -0.7, 0.5], [0.2, -0.5, -1], [-0.5, 0.3, -0.9]]
)
WIDTHS = np.array([0.34, 0.26, 0.32, 0.24, 0.3])
AT_REST = np.full((1, 5), 1.5)
WORDS = np.array(Key(bytes(range(32))).words("apex", Apex().n_words, Apex().n_chips))


def horned(heights) -> MeshAnimation:
    """Five horns of heights (T, 5) over time."""
    frames = [bumpy_sphere(4, HORNS, height, WIDTHS) for height in heights]
    return MeshAnimation.from_arrays(np.stack([V for V, _ in frames]), frames[0][1])


def kept(d) -> ScratchFile:
    scratch = ScratchFile.create(len(d), d.shape[1] // 3, DOUBLE)
    for j, displacement in enumerate(d):
        scratch.write(j, displacement)
    return scratch


def hypothesis_as_marked(frame):
    """Index among the hypotheses of a frame of the one it was marked under."""
    length = reference_root_area(frame.points, frame.faces)
    hypotheses = ScaleHypotheses.about(length)
    unit = relative_units(length, np.array([nearest_residue(length)]))
    kept = (hypotheses.jitter == 1.0) & (np.abs(hypotheses.scales(length) * unit - 1.0) < 1e-9)
    return int(np.flatnonzero(kept)[0]) * len(OFFSETS)


def test_every_horn_reads_the_word_it_was_given_and_did_not_before():
    animation = horned(AT_REST)
    frame, scheme = animation[0], Apex()
    anchors = require_capacity(FrameAnchors(animation, 1), scheme.parameters)
    plan = scheme.plan(animation, WORDS)
    words, hypothesis = WORDS[anchors.words], hypothesis_as_marked(frame)
    before, after = (
        scheme.observe(frame.moved(P)).soft[hypothesis] @ words.T
        for P in (frame.points, plan.mark(0, frame))
    )
    # Of 16 at the very best.
    assert np.diag(after).min() > 8.0
    assert np.abs(before).max() < 6.0


REFUSED = {
    "sphere": (icosphere(4), "tips such as hands, feet.*choose another scheme"),
    "torus": (torus(60, 30), "mark the mesh this one is worn by.*choose another scheme"),
    "plane": (plane(40), "tips lie on open borders.*choose another scheme"),
    "prop": (capsule(14, 21), r"296 points give \d+ chips.*takes 40.*subdivide it"),
}


@pytest.mark.parametrize(("mesh", "reason"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_hold_a_mark_is_refused_with_what_to_do(mesh, reason):
    animation = MeshAnimation.from_arrays(*mesh)
    with pytest.raises(CapacityError, match=reason):
        Apex().require_capacity(animation)
    with pytest.raises(CapacityError, match=reason):
        Apex().plan(animation, WORDS)


OUT_OF_RANGE = {
    "bins": [1, 65, 14.5, True, None],
    "width": [0.0, 0.5, -0.1, np.nan, "0.1"],
    "words": [1, 11, 8.0],
    "strength": [0, 1, np.inf],
    "max_mrms": [0.0, 0.1, -1e-4],
    "hold": [0, 10_001, 2.5],
}


@pytest.mark.parametrize(("name", "values"), OUT_OF_RANGE.items())
def test_a_parameter_out_of_range_is_named(name, values):
    for value in values:
        with pytest.raises(UsageError, match=rf"^scheme apex: {name} must be a .*, not "):
            Apex(**{name: value})


EVIDENCE_IN_PER_CENT = """
  31  -38  -11   32   -3   42   29    2  -41  -12  -26   -8   45   -8   60   18
 -41    4  -32   27   38  -17  -15    0  -11  -13  -51    3  -30   34    7  -10
 -15  -40  -11   68   35   42    3   15   27  -26   -1  -45  -16  -12    1   13
  22  -29   -9  -39    1    0   14   -8  -33  -20    7    6   18  -72   19   -2
  15  -29  -13  -38  -15   47   -7   13   10   10  -43   24   12   64   33   44
 -13    0  -25   45   -2  -19    0   29   14  -44   14  -10   40  -28    7    3
"""
POSITIONS = [53.78, 53.46, 53.77, 53.44, 55.46, 63.09]


def test_anchors_and_evidence_of_the_creature(creature):
    seen, hypothesis = Apex().observe(creature[0]), hypothesis_as_marked(creature[0])
    assert seen.vertices.tolist() == [327, 3180, 85, 2694, 0, 6935]
    wanted = np.array(EVIDENCE_IN_PER_CENT.split(), dtype=float).reshape(6, 16)
    np.testing.assert_allclose(100.0 * seen.soft[hypothesis], wanted, atol=0.6)
    np.testing.assert_allclose(seen.posterior.position[hypothesis], POSITIONS, atol=0.02)
