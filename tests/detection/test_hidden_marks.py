"""Marks that were to be hidden for nothing: things joined to a mesh, cuts, junk, bad frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

import meshmark
from folders import FAULTS
from meshmark.detection.candidates import candidates
from meshmark.detection.verdict import Verdict
from meshmark.errors import InputError
from meshmark.extension.recipe import Recipe
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.topology import Topology, face_adjacency
from meshmark.testing.meshes import plane, side_by_side, torus

NAMES = ["acme", "globex"]
APEX = [Recipe("apex")]


@pytest.fixture(scope="module")
def key() -> meshmark.Key:
    return meshmark.Key.load(FAULTS / "test.key")


@pytest.fixture(scope="module")
def marked() -> tuple[np.ndarray, np.ndarray]:
    """A body of 8431 points that bears the words of acme."""
    frame = meshmark.read(FAULTS / "two-recipients/two_meshes.usdc").mesh("/World/a")[0]
    return frame.points, frame.faces


def animation(points, F, prim="/World/body") -> MeshAnimation:
    return MeshAnimation.from_arrays(points, F, prim=prim)


def verdict_on(meshes, key, recipients: Sequence[str] = NAMES, frames="auto") -> Verdict:
    asset = Asset(source="copy", meshes=tuple(meshes), reader="memory")
    return meshmark.verify(asset, key, recipes=APEX, recipients=recipients, frames=frames)


def found(name) -> Asset:
    return meshmark.read(FAULTS / name)


def test_a_ground_joined_to_a_marked_body_hides_nothing(key) -> None:
    asset = found("joined/ground_2x2.usdc")
    verdict = meshmark.verify(asset, key, recipes=APEX, recipients=["acme"], frames="auto")
    assert (verdict.verdict, verdict.recipient) == ("marked", "acme")
    assert verdict.prims[0].part == "surface 1"
    assert verdict.log10_p < -20


@pytest.mark.slow
def test_junk_before_marked_frames_hides_nothing(key) -> None:
    asset = found("first-frame/first_scrambled.usdc")
    for frames in ("auto", ":"):
        verdict = meshmark.verify(asset, key, recipes=APEX, recipients=NAMES, frames=frames)
        assert (verdict.verdict, verdict.recipient) == ("marked", "acme")


def test_everybody_whose_words_are_found_is_named_mesh_by_mesh(key) -> None:
    asset = found("two-recipients/two_meshes.usdc")
    for frames in ("auto", ":"):
        verdict = meshmark.verify(asset, key, recipes=APEX, recipients=NAMES, frames=frames)
        assert {named.recipient for named in verdict.recipients} == {"acme", "globex"}
        of_prim = {prim.prim: [one.recipient for one in prim.recipients] for prim in verdict.prims}
        assert of_prim == {"/World/a": ["acme"], "/World/b": ["globex"]}


def test_everybody_whose_words_are_found_is_named_frame_by_frame(key) -> None:
    asset = found("two-recipients/two_meshes.usdc")
    one, two = (asset.mesh(prim)[0] for prim in ("/World/a", "/World/b"))
    spliced = animation(np.array([one.points, one.points, two.points, one.points]), one.faces)
    verdict = verdict_on([spliced], key)
    times = {named.recipient: named.times for named in verdict.prims[0].recipients}
    assert times == {"acme": (1.0, 2.0, 4.0), "globex": (3.0,)}


def box(V) -> tuple[np.ndarray, np.ndarray]:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    F = np.array([[a, b, c] for a, b, c, d in quads] + [[a, c, d] for a, b, c, d in quads])
    return corners * 3 * np.ptp(V, axis=0).max() + V.mean(axis=0), F


def hung_on(V, F, edge, hung, faces) -> tuple[np.ndarray, np.ndarray]:
    """Hang something on an edge of a mesh."""
    n = len(V)
    flap = [[*edge, n], [edge[1], n + 1, n]]
    return np.concatenate([V, hung]), np.concatenate([F, faces + n, flap])


def wall(V, F) -> tuple[np.ndarray, np.ndarray]:
    """Close a body off in the middle, along edges of its own."""
    front = V[F].mean(axis=1)[:, 0] > np.median(V[:, 0])
    pairs, shared = face_adjacency(F)
    loop = shared[front[pairs[:, 0]] != front[pairs[:, 1]]]
    middle = V[np.unique(loop)].mean(axis=0)
    spokes = np.column_stack([loop, np.full(len(loop), len(V))])
    return np.concatenate([V, middle[None]]), np.concatenate([F, spokes])


def cut(V, F, n, gap) -> list[tuple[np.ndarray, np.ndarray]]:
    """Cut a mesh into patches, a share of its size apart."""
    rng = np.random.default_rng(n)
    middle = V[F].mean(axis=1)
    seeds = middle[rng.choice(len(F), n, replace=False)]
    label = ((middle[:, None] - seeds) ** 2).sum(axis=2).argmin(axis=1)
    away = rng.normal(size=(n, 3)) * gap * np.ptp(V, axis=0).max() / 2
    patches = []
    for one in range(n):
        used, local = np.unique(F[label == one], return_inverse=True)
        patches.append((V[used] + away[one], local.reshape(-1, 3)))
    return patches


@pytest.mark.parametrize("thing", ["box", "fine ground", "ring", "sheet", "wall"])
def test_what_is_joined_to_a_body_hides_nothing(key, marked, thing) -> None:
    V, F = marked
    size = np.ptp(V, axis=0).max()
    if thing == "box":
        V, F = side_by_side((V, F), box(V))
    elif thing == "fine ground":
        ground, faces = plane(40, side=4 * size)
        V, F = side_by_side((V, F), (ground + V.min(axis=0), faces))
    elif thing == "ring":
        ring, faces = torus(80, 40, major=size, minor=0.3 * size)
        V, F = side_by_side((V, F), (ring, faces))
    elif thing == "sheet":
        # Folded up within the body, of five times its area.
        sheet, faces = plane(60, side=1.0)
        z = np.round(sheet[:, 0] * 59).astype(int)
        sheet = np.column_stack([0.02 * size * (z % 2), z * 1e-6 * size, sheet[:, 1] * 5 * size])
        V, F = hung_on(V, F, F[100, :2], sheet + V.mean(axis=0), faces)
    else:
        V, F = wall(V, F)
    verdict = verdict_on([animation(V, F)], key)
    assert (verdict.verdict, verdict.recipient) == ("marked", "acme")
    assert verdict.prims[0].part.startswith("surface")
    assert verdict.log10_p < -20


@pytest.mark.parametrize(
    ("n", "gap", "as_prims"),
    [(12, 1e-6, False), (12, 1e-6, True), (3, 0.0, True), (7, 1e-3, False)],
)
def test_what_is_cut_apart_is_sewn_together(key, marked, n, gap, as_prims) -> None:
    patches = cut(*marked, n, gap)
    meshes = [animation(*side_by_side(*patches))]
    if as_prims:
        meshes = [animation(*patch, prim=f"/World/p{i}") for i, patch in enumerate(patches)]
    verdict = verdict_on(meshes, key)
    assert (verdict.verdict, verdict.recipient) == ("marked", "acme")
    assert verdict.log10_p < -20
    assert verdict.prims[0].part == "sewn together"
    if as_prims:
        assert len(verdict.prims) == n
        assert len(verdict.prims[0].also) == n - 1


def test_a_face_that_cannot_be_used_is_named_and_passed_over(key) -> None:
    copy = meshmark.read(FAULTS / "bad-sample/index_out_of_range.usdc")
    verdict = meshmark.verify(copy, key, recipients=["acme"])
    assert (verdict.verdict, verdict.recipient) == ("marked", "acme")
    [note] = verdict.notes
    assert note.startswith("passed over: /World/body: 1 of 16844 faces cannot be used")


def test_frames_that_cannot_be_read_are_named_and_passed_over(key, marked) -> None:
    V, F = marked
    points = np.repeat(V[None], 4, axis=0)
    points[0, 17] = np.nan
    points[2] = V[0]
    for frames in ("auto", ":"):
        verdict = verdict_on([animation(points, F)], key, frames=frames)
        assert (verdict.verdict, verdict.recipient) == ("marked", "acme")
        notes = [note for note in verdict.notes if note.startswith("passed over")]
        if frames == ":":
            assert [note.split(":")[2] for note in notes] == [" frame 1", " frame 3"]
    with pytest.raises(InputError, match="frame 1: point 17 is not finite"):
        verdict_on([animation(points[[0, 2]], F)], key)


@pytest.mark.slow
@pytest.mark.parametrize("frames", ["2:5:2", "1:3", "5:"])
def test_junk_beyond_the_frames_asked_for_is_none_of_the_answer(key, marked, frames) -> None:
    V, F = marked
    rng = np.random.default_rng(0)
    points = [rng.permutation(V), V, V, rng.permutation(V), V, rng.permutation(V)]
    verdict = verdict_on([animation(np.array(points), F)], key, frames=frames)
    assert (verdict.verdict, verdict.recipient) == ("marked", "acme")


def test_a_polygon_of_twenty_thousand_corners_hides_nothing(key, marked) -> None:
    V, F = marked
    n, rng = 20_000, np.random.default_rng(0)
    counts = np.append(np.full(len(F), 3), n)
    for corners in (rng.integers(0, len(V), n), np.arange(len(V), len(V) + n)):
        points = np.concatenate([V, rng.normal(size=(n, 3))])
        topology = Topology(counts, np.append(F.ravel(), corners), len(points))
        mesh = MeshAnimation.from_frames([Frame(1.0, points, topology)], prim="/World/body")
        verdict = verdict_on([mesh], key)
        assert (verdict.verdict, verdict.recipient) == ("marked", "acme")


@pytest.mark.slow
def test_junk_in_most_frames_hides_nothing(key, marked) -> None:
    V, F = marked
    rng = np.random.default_rng(0)
    points = [V if t in (3, 8) else rng.permutation(V) for t in range(11)]
    verdict = verdict_on([animation(np.array(points), F)], key)
    assert (verdict.verdict, verdict.recipient) == ("marked", "acme")


def test_a_heap_of_cubes_costs_nothing(key, marked) -> None:
    rng = np.random.default_rng(0)
    cube, faces = box(np.array([[0.0, 0, 0], [0.1, 0.1, 0.1]]))
    cubes = [animation(cube + rng.normal(size=3), faces, f"/World/c{i}") for i in range(40)]
    alone = verdict_on([animation(*marked)], key)
    heap = verdict_on([animation(*marked), *cubes], key)
    assert heap.log10_p == pytest.approx(alone.log10_p)
    assert len(heap.prims) == 41


def test_other_keys_find_nothing_in_any_part(key, marked) -> None:
    other = meshmark.Key(bytes(range(32)))
    V, F = side_by_side(marked, plane(40, side=4.0))
    verdict = verdict_on([animation(V, F)], other, frames=":")
    assert (verdict.verdict, verdict.recipients) == ("not marked", ())
    assert verdict.prims[0].recipients == ()


def test_surfaces_and_runs_of_them_are_candidates() -> None:
    ball = torus(40, 20)
    V, F = side_by_side(ball, ball, ball, torus(8, 6))
    asset = Asset(source="copy", meshes=(animation(V, F),), reader="memory")
    parts = [candidate.part for candidate in candidates(asset)]
    singles = ["surface 1", "surface 2", "surface 3"]
    assert parts == ["", *singles, "surfaces 1, 2", "surfaces 2, 3"]
    assert [len(c.animation[0].faces) for c in candidates(asset)[1:4]] == [1600] * 3
    alone = Asset(source="copy", meshes=(animation(*ball),), reader="memory")
    assert [candidate.part for candidate in candidates(alone)] == [""]
