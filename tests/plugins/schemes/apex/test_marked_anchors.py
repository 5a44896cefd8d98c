"""Units and words that the anchors of an animation are given."""

from __future__ import annotations

import numpy as np

from meshmark.mesh.animation import MeshAnimation
from meshmark.testing.meshes import capsule
from meshmark_plugins.schemes.apex.anchors.components import reference_root_area
from meshmark_plugins.schemes.apex.chips.unit_series import nearest_residue, relative_units
from meshmark_plugins.schemes.apex.marking.marked_anchors import assign_units_and_words
from meshmark_plugins.schemes.apex.parameters import Parameters

PARAMETERS = Parameters(16, 0.04, 8, 0.36, 2.2e-4, 8)


def test_every_anchor_is_given_a_unit_and_a_word_of_its_own():
    V, F = capsule(48, 100, 0.6)
    animation = MeshAnimation.from_arrays(V[None], F)
    vertices = np.array([len(V) - 1, len(V) - 2])
    anchors = assign_units_and_words(animation, vertices, PARAMETERS, 1)
    assert anchors.vertices is vertices
    length = reference_root_area(V, F)
    np.testing.assert_allclose(
        anchors.units, relative_units(length, np.array([nearest_residue(length)]))[0]
    )
    # Both ends are alike: neighbouring words.
    assert abs(int(anchors.words[0]) - int(anchors.words[1])) == 1
    ((rows, field),) = anchors.fields(V, F)
    np.testing.assert_array_equal(vertices[rows], field.anchors)
