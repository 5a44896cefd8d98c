"""What moves in glTF files: nodes, skins, morph targets and clips, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from gltf_files import QUAD, QUAD_FACES, QUARTER, ball, quad, skinned_quad
from meshmark.errors import UsageError
from meshmark_plugins.readers.gltf.reader import GltfReader

UP = np.array([0.0, 0.0, 1.0])


def test_nodes_place_their_meshes_in_world_space(read):
    made = quad()
    made.json["nodes"][0].update(translation=[1, 2, 3], scale=[2, 1, 1])
    made.add("nodes", children=[0], rotation=QUARTER, name="turned")
    # In column order: x by 10, and 5 up.
    matrix = [10, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 5, 1]
    made.add("nodes", children=[1], matrix=matrix, name="top")
    [mesh] = read(made).meshes
    local = QUAD * [2, 1, 1] + [1, 2, 3]
    turned = np.stack([-local[:, 1], local[:, 0], local[:, 2]], axis=1)
    np.testing.assert_allclose(mesh[0].points, turned * [10, 1, 1] + [0, 0, 5], atol=1e-12)
    assert mesh.prim == "/top/turned/quad"
    assert np.isnan(mesh.times).all()


@pytest.mark.parametrize(
    ("interpolation", "values", "wanted"),
    [
        ("STEP", [0, 4], [0, 0, 0, 0, 4]),
        ("LINEAR", [0, 4], [0, 1, 2, 3, 4]),
        # h00, h10, h01 and h11 at 0, 1/4, .., 1 over a second, with slopes 8 out and 0 in.
        ("CUBICSPLINE", [[9, 0, 8], [0, 4, 9]], [0, 1.75, 3, 3.75, 4]),
    ],
)
def test_values_between_keys(read, interpolation, values, wanted):
    made = quad()
    moves = np.reshape(values, (-1, 1)) * [[1.0, 0, 0]]
    made.animate(0, "translation", [1, 2], moves, interpolation=interpolation)
    asset = read(made, fps=4)
    [mesh] = asset.meshes
    np.testing.assert_array_equal(mesh.times, [4, 5, 6, 7, 8])
    np.testing.assert_allclose([frame.points[0, 0] for frame in mesh], wanted, atol=1e-6)


@pytest.mark.parametrize("sign", [1, -1])
def test_rotations_keep_their_speed_and_take_the_shorter_way(read, sign):
    made = quad()
    angle = np.radians(80)
    end = sign * np.array([0, 0, np.sin(angle / 2), np.cos(angle / 2)])
    made.animate(0, "rotation", [0, 1], [[0, 0, 0, 1], 3 * end])
    [mesh] = read(made, fps=4).meshes
    corners = np.array([frame.points[1] for frame in mesh])
    angles = np.degrees(np.arctan2(corners[:, 1], corners[:, 0]))
    np.testing.assert_allclose(angles, [0, 20, 40, 60, 80], atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(corners, axis=1), 1, atol=1e-6)


def about_z(degrees):
    half = np.radians(degrees) / 2
    return np.array([0, 0, np.sin(half), np.cos(half)])


def test_each_of_several_nodes_turns_at_its_own_speed(read):
    made = quad()
    for node in range(3):
        made.add("nodes", children=[node])
    # Far, next to nothing, the longer way round, and with keys of its own.
    for node, (times, end) in enumerate(
        [
            ([0, 1], about_z(80)),
            ([0, 1], about_z(1)),
            ([0, 1], -about_z(-40)),
            ([0, 2], about_z(90)),
        ]
    ):
        made.animate(node, "rotation", times, [[0, 0, 0, 1], end])
    mesh = read(made, fps=4).meshes[0]
    corners = np.array([frame.points[1] for frame in mesh][:5])
    angles = np.degrees(np.arctan2(corners[:, 1], corners[:, 0]))
    np.testing.assert_allclose(angles, np.arange(5) / 4 * (80 + 1 - 40 + 45), atol=1e-5)


def test_an_animated_matrix_is_taken_apart(read):
    made = quad()
    # Mirrored in x, turned a quarter about z, scaled by 3, moved.
    made.json["nodes"][0]["matrix"] = [0, -3, 0, 0, -3, 0, 0, 0, 0, 0, 3, 0, 1, 2, 3, 1]
    still = read(made).meshes[0][0].points
    made.animate(0, "translation", [0, 1], [[1, 2, 3], [1, 2, 4]])
    mesh = read(made, fps=2).meshes[0]
    np.testing.assert_allclose(mesh[0].points, still, atol=1e-9)
    np.testing.assert_allclose(mesh[2].points, still + UP, atol=1e-9)


def test_skins_blend_their_joints_and_ignore_the_node(read):
    weights = [[1, 0, 0, 0], [0, 1, 0, 0], [0.5, 0.5, 0, 0], [3, 1, 0, 0]]
    [mesh] = read(skinned_quad(weights)).meshes
    # The first joint leaves points where they are; the second turns them, and lifts them by 5.
    turned = np.stack([-QUAD[:, 1], QUAD[:, 0] + 5, QUAD[:, 2]], axis=1)
    share = np.array([0, 1, 0.5, 0.25])[:, None]
    wanted = (1 - share) * QUAD + share * turned
    np.testing.assert_allclose(mesh[0].points, wanted, atol=1e-6)


def test_weights_may_be_normalised_integers(read):
    weights = [[255, 0, 0, 0], [0, 255, 0, 0], [128, 127, 0, 0], [51, 204, 0, 0]]
    [mesh] = read(skinned_quad(weights, "u1", normalized=True)).meshes
    turned = np.stack([-QUAD[:, 1], QUAD[:, 0] + 5, QUAD[:, 2]], axis=1)
    share = np.array([0, 1, 127 / 255, 0.8])[:, None]
    np.testing.assert_allclose(mesh[0].points, (1 - share) * QUAD + share * turned, atol=1e-6)


def test_further_sets_of_joints_count(read):
    made = skinned_quad([[1, 0, 0, 0]] * 4)
    attributes = made.json["meshes"][0]["primitives"][0]["attributes"]
    attributes["JOINTS_1"] = made.accessor([[1, 0, 0, 0]] * 4, "u1")
    attributes["WEIGHTS_1"] = made.accessor([[1, 0, 0, 0]] * 4)
    turned = np.stack([-QUAD[:, 1], QUAD[:, 0] + 5, QUAD[:, 2]], axis=1)
    np.testing.assert_allclose(read(made).meshes[0][0].points, (QUAD + turned) / 2, atol=1e-6)


def test_vertices_without_joints_stay_with_the_node(read):
    [mesh] = read(skinned_quad([[0, 0, 0, 0], *[[1, 0, 0, 0]] * 3])).meshes
    wanted = QUAD + np.outer([1, 0, 0, 0], [100, 0, 0])
    np.testing.assert_allclose(mesh[0].points, wanted, atol=1e-6)


def test_meshes_know_which_joints_move_them(read):
    weights = [[0, 0, 0, 0], [0, 1, 0, 0], [0.5, 0.5, 0, 0], [3, 1, 0, 0]]
    found = read(skinned_quad(weights)).meshes[0].skinning
    np.testing.assert_allclose(found.rest, QUAD, atol=1e-6)
    of_joints = np.zeros((4, 3))
    np.add.at(of_joints, (np.arange(4)[:, None], found.joints), found.weights)
    # The last stands for the node.
    wanted = [[0, 0, 1], [0, 1, 0], [0.5, 0.5, 0], [0.75, 0.25, 0]]
    np.testing.assert_allclose(of_joints, wanted, atol=1e-6)
    assert read(quad()).meshes[0].skinning is None


def morphing_quad():
    made = quad()
    up = np.tile(UP, (4, 1))
    sparse = {
        "count": 1,
        "indices": {"bufferView": made.view(b"\2\0"), "componentType": 5123},
        "values": {"bufferView": made.view(np.array([5, 0, 0], "<f4").tobytes())},
    }
    sparse_target = made.add("accessors", **made.describe(QUAD), sparse=sparse)
    targets = [{"POSITION": made.accessor(up)}, {"POSITION": sparse_target}, {"NORMAL": 0}]
    made.json["meshes"][0]["primitives"][0]["targets"] = targets
    return made


SPARSE = np.array([[0, 0, 0], [0, 0, 0], [5, 0, 0], [0, 0, 0]])


@pytest.mark.parametrize(
    ("mesh", "node", "wanted"),
    [
        (None, None, QUAD),
        ([0.5, 2, 9], None, QUAD + UP / 2 + 2 * SPARSE),
        ([0.5, 2, 9], [1, 0, 0], QUAD + UP),
    ],
)
def test_morph_targets_have_weights_of_mesh_or_node(read, mesh, node, wanted):
    made = morphing_quad()
    made.json["meshes"][0].update({"weights": mesh} if mesh else {})
    made.json["nodes"][0].update({"weights": node} if node else {})
    np.testing.assert_allclose(read(made).meshes[0][0].points, wanted, atol=1e-6)


def test_weights_of_morph_targets_are_animated(read):
    made = morphing_quad()
    made.animate(0, "weights", [0, 1], [[0, 0, 0], [1, 2, 3]])
    mesh = read(made, fps=2).meshes[0]
    np.testing.assert_allclose(mesh[1].points, QUAD + UP / 2 + SPARSE, atol=1e-6)


@pytest.mark.parametrize(
    ("times", "fps", "codes"),
    [
        (np.arange(25) / 24, 24, range(25)),
        # Keys of frame 1 on, as Blender writes them; float32 seconds.
        (np.arange(1, 250) / 30, 30, range(1, 250)),
        # Even keys that are not dense enough for what is between them.
        ([0, 1], 24, range(25)),
        (np.arange(5) / 10, 30, range(13)),
        # A sudden change does not count.
        ([0, 0.04, 0.08, 0.085, 0.12, 0.16, 0.2], 25, range(6)),
        (np.arange(48) / (24 / 1.001), 24 / 1.001, range(48)),
        # Shorter than a frame; nothing but a key.
        ([0.51, 0.512], 500, [255, 256]),
        ([0.51], 24, [12.24]),
    ],
)
def test_time_codes_are_frames_of_the_densest_keys(read, times, fps, codes):
    made = quad()
    made.animate(0, "translation", times, np.outer(times, [1, 0, 0]))
    asset = read(made)
    assert asset.fps == pytest.approx(fps, rel=1e-6)
    np.testing.assert_allclose(asset.meshes[0].times, list(codes), rtol=1e-6)


def test_what_a_clip_does_not_change_has_no_time(read):
    made = ball()
    made.add("nodes", mesh=made.mesh(made.primitive(QUAD, QUAD_FACES)), name="floor")
    asset = read(made)
    assert {mesh.prim: len(mesh) for mesh in asset.meshes} == {"/root/ball": 17, "/floor": 1}


def test_clips_are_chosen_by_name(read):
    made = quad()
    made.animate(0, "translation", [0, 1], [[0, 0, 0], [1, 0, 0]])
    made.json["animations"][0]["name"] = "Walk"
    made.json["animations"].append({"channels": [], "samplers": [], "name": "Run"})
    made.animate(0, "scale", [0, 2], [[1, 1, 1], [2, 2, 2]])
    made.json["animations"].append({"channels": [], "samplers": []})
    assert read(made).meshes[0][-1].points[1, 0] == 2
    assert read(made).notes == ("clip 'Walk' is read; there is also 'Run', 'animation2'",)
    run = read(made, clip="Run", fps=1).meshes[0]
    np.testing.assert_array_equal(run.times, [0, 1, 2])
    assert run[-1].points[1, 0] == 2
    assert len(read(made, clip="animation2").meshes[0]) == 1
    with pytest.raises(UsageError, match="no clip 'Crawl'; there is 'Walk', 'Run', 'animation2'"):
        read(made, clip="Crawl")
    with pytest.raises(UsageError, match="fps"):
        GltfReader(fps=-1)
