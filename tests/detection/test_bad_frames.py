"""One bad frame, or face, must not hide the rest; and none is marked, or passed over, unsaid."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from meshmark import mark_file
from meshmark.commands.inspect import inspect_asset
from meshmark.embedding.asset import embed
from meshmark.errors import CapacityError, InputError
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.checks import bad_frames, check
from meshmark.mesh.frame_agreement import agreed
from meshmark.mesh.topology import Topology
from meshmark.metrics.surface_distance import surface_distance
from meshmark.testing.attacks import sphere
from meshmark.testing.schemas import schema_folder
from meshmark.usd.stages import write_stage
from meshmark_plugins.readers.obj import ObjFrames
from usd_stages import CUBE_COUNTS, CUBE_INDICES, CUBE_POINTS, array, cube, read_one, write_text

KEY = Key(bytes(range(32)))
GOOD = dict.fromkeys(range(2, 12), array(CUBE_POINTS))
BAD_POINTS = {
    "nan": (array(CUBE_POINTS).replace("(0, 0, 0)", "(nan, 0, 0)"), "point 0 is not finite"),
    "none": ("[]", "no points"),
    "blocked": ("None", "no points"),
    "fewer": (array(CUBE_POINTS[:5]), "5 points here but 8 at most times"),
    "more": (array(np.tile(CUBE_POINTS, (2, 1))), "16 points here but 8 at most times"),
}
BAD_INDICES = {
    "out of range": ([*CUBE_INDICES[:-1], 99999], "other faces"),
    "negative": ([*CUBE_INDICES[:-1], -1], "other faces"),
    "too few": (CUBE_INDICES[:-1], "23 faceVertexIndices, where 24 are expected"),
    "none": ([], "0 faceVertexIndices, where 24 are expected"),
    "others": ([CUBE_INDICES[-1], *CUBE_INDICES[:-1]], "other faces"),
}


def stage(folder: Path, points: dict[int, str], indices: dict[int, list[int]] | None) -> str:
    spelt = ", ".join(f"{time}: {value}" for time, value in sorted(points.items()))
    body = cube(points=f"point3f[] points.timeSamples = {{ {spelt} }}")
    if indices is not None:
        spelt = ", ".join(f"{time}: {value}" for time, value in sorted(indices.items()))
        body = body.replace(
            f"faceVertexIndices = {CUBE_INDICES}", f"faceVertexIndices.timeSamples = {{ {spelt} }}"
        )
    return write_text(folder / "a.usda", body)


@pytest.mark.parametrize("time", [1, 7, 12])
@pytest.mark.parametrize("name", BAD_POINTS)
def test_bad_points_of_one_frame_are_bad_there_only(tmp_path: Path, name: str, time: int) -> None:
    text, message = BAD_POINTS[name]
    mesh = read_one(stage(tmp_path, {**GOOD, 1: GOOD[2], 12: GOOD[2], time: text}, None))
    ((index, error),) = bad_frames(mesh)
    assert mesh.times[index] == time == error.time
    assert message in error.message
    assert mesh.constant_topology
    assert sum(len(frame.points) == 8 for i, frame in frames_but(mesh, index)) == 11


@pytest.mark.parametrize("time", [1, 7])
@pytest.mark.parametrize("name", BAD_INDICES)
def test_bad_faces_of_one_frame_are_bad_there_only(tmp_path: Path, name: str, time: int) -> None:
    bad, message = BAD_INDICES[name]
    indices = dict.fromkeys(range(1, 12), CUBE_INDICES) | {time: bad}
    mesh = read_one(stage(tmp_path, {**GOOD, 1: GOOD[2]}, indices))
    ((index, error),) = bad_frames(mesh)
    assert mesh.times[index] == time == error.time
    assert message in error.message
    assert mesh.constant_topology
    for _, frame in frames_but(mesh, index):
        assert frame.topology.counts.tolist() == CUBE_COUNTS


def frames_but(mesh: MeshAnimation, left_out: int):
    return ((i, mesh[i]) for i in range(len(mesh)) if i != left_out)


def test_a_mesh_without_any_good_frame_is_refused(tmp_path: Path) -> None:
    text = BAD_POINTS["nan"][0]
    with pytest.raises(InputError, match="/cube: frame 1: point 0 is not finite"):
        read_one(stage(tmp_path, dict.fromkeys(range(1, 12), text), None))


def test_what_most_frames_agree_on() -> None:
    assert agreed(["a"] * 10) == (0, ())
    assert agreed([None, "b", *"aaaaaaaaa"]) == (2, (0, 1))
    # Too many differ: the connectivity changes, and no frame is passed over.
    assert agreed([*"bb", *"aaaaaaaaa"]) is None
    assert agreed([None, None]) is None
    # What is no mesh has no say.
    assert agreed([None, None, None, "a"]) == (3, (0, 1, 2))


@pytest.mark.parametrize("first", ["f 1 2 9", "v 0 0 nan", "v 1 2", "", "f 1 2 /3", "f 1 2"])
def test_one_bad_obj_file_is_bad_alone(tmp_path: Path, first: str) -> None:
    good = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    for i in range(1, 12):
        (tmp_path / f"{i}.obj").write_text(good)
    (tmp_path / "0.obj").write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\n{first}\n")
    (mesh,) = ObjFrames().read(str(tmp_path)).meshes
    assert mesh.constant_topology
    ((index, error),) = bad_frames(mesh)
    assert index == 0
    assert error.source == str(tmp_path / "0.obj")


@pytest.mark.parametrize(
    ("counts", "indices"), [([3, 3], [0, 1, 2, 0, 1, 9]), ([3, 2], [0, 1, 2, 0, 1])]
)
def test_faces_that_are_none_are_left_out_and_told(counts: list[int], indices: list[int]) -> None:
    topology = Topology.fit(np.array(counts), np.array(indices), 3)
    assert topology.triangles.tolist() == [[0, 1, 2]]
    assert topology.left_out.startswith("1 of 2 faces cannot be used: ")
    with pytest.raises(InputError):
        Topology.fit(np.array(counts[1:]), np.array(indices[3:]), 3)


def test_a_mesh_with_a_bad_face_is_looked_at_but_not_marked(tmp_path: Path) -> None:
    spoilt = cube().replace(str(CUBE_INDICES), str([*CUBE_INDICES[:-1], 99999]))
    mesh = read_one(write_text(tmp_path / "a.usda", spoilt))
    assert len(mesh[0].faces) == 10
    assert bad_frames(mesh) == ()
    told = "1 of 6 faces cannot be used: face index 99999 is out of range for 8 points"
    assert mesh.notes == (told,)
    for refuse in (check, lambda mesh: embed(mesh, KEY)):
        with pytest.raises(InputError, match="/cube: 1 of 6 faces cannot be used"):
            refuse(mesh)
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 7\n")
    (mesh,) = ObjFrames().read(str(tmp_path / "a.obj")).meshes
    assert mesh.flaw == (
        "1 of 2 faces cannot be used: line 5: face index 7 is out of range for 3 vertices"
    )


def test_inspect_tells_bad_frames(tmp_path: Path) -> None:
    source = stage(tmp_path, {**GOOD, 1: BAD_POINTS["nan"][0]}, None)
    asset = Asset(source, (read_one(source),), "usd")
    (found,) = inspect_asset(asset, RECIPE)["prims"]
    assert not found["can_hold"]
    assert found["reason"] == "1 bad frames: /cube: frame 1: point 0 is not finite: [nan, 0.0, 0.0]"
    assert found["points"] == 8


RECIPE = Recipe("cho2007", settings={"cho2007": {"bits": 16}})


def shrinking(tmp_path: Path) -> Path:
    """Write a ball that begins as a point, and is scaled to a line later."""
    V, F = sphere(600)
    frames = np.stack([0 * V + 5, V, V * [0, 2, 0], 1.1 * V])
    mesh = MeshAnimation.from_arrays(frames, F, prim="/ball")
    write_stage(Asset("x", (mesh,), "memory"), tmp_path / "ball.usdc")
    return tmp_path / "ball.usdc"


def test_frames_scaled_to_nothing_are_passed_over_and_told(tmp_path: Path) -> None:
    source, output = shrinking(tmp_path), tmp_path / "o.usdc"
    document = mark_file(source, output, KEY, recipe=RECIPE).document
    schema = json.loads((schema_folder("json") / "manifest.schema.json").read_text())
    jsonschema.validate(document, schema)
    (prim,) = document["prims"]
    assert prim["marked_frames"] == 2
    assert prim["passed_over"] == [
        {"time": 1.0, "reason": "the mesh is scaled to nothing"},
        {"time": 3.0, "reason": "the mesh is scaled to a line: it has no area"},
    ]
    moved = [
        bool(np.any(after.points != before.points))
        for before, after in zip(read_one(str(source)), read_one(str(output)), strict=True)
    ]
    assert moved == [False, True, False, True]
    (found,) = inspect_asset(Asset("x", (read_one(str(source)),), "usd"), RECIPE)["prims"]
    assert found["can_hold"], found["reason"]
    assert found["notes"] == ["2 frames would be passed over: the mesh is scaled to nothing"]


def test_frames_scaled_to_nothing_are_delivered_only_where_somebody_agrees(tmp_path: Path) -> None:
    source, output = shrinking(tmp_path), tmp_path / "o.usdc"
    with pytest.raises(CapacityError, match=r"/ball: would be delivered unmarked: .* in 2 frames"):
        mark_file(source, output, KEY, recipe=RECIPE, deliver=True)
    assert not output.exists()
    mark_file(source, output, KEY, recipe=RECIPE, deliver=True, allow_unmarked=["/ball"])
    assert output.exists()


def test_a_mesh_scaled_to_nothing_all_the_time_cannot_be_marked() -> None:
    V, F = sphere(600)
    with pytest.raises(CapacityError, match="scaled to nothing"):
        embed(MeshAnimation.from_arrays(0 * V, F), KEY, recipe=RECIPE)


def test_points_that_no_face_uses_are_no_part_of_the_diagonal() -> None:
    V, F = sphere(200)
    far = np.concatenate([V, [[1e6, 0, 0]]])
    moved = replace_row(V, 5, V[5] * 1.01)
    plain = surface_distance(V, F, moved, F)
    beside = surface_distance(far, F, np.concatenate([moved, [[1e6, 0, 0]]]), F)
    assert beside.diagonal == plain.diagonal
    assert beside.mrms == pytest.approx(plain.mrms, rel=1e-6)


def replace_row(V: np.ndarray, row: int, point: np.ndarray) -> np.ndarray:
    moved = V.copy()
    moved[row] = point
    return moved
