"""How far a surface slid under its texture, on maps whose answer is known; and where they are."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

from meshmark.embedding.file import mark_file
from meshmark.errors import UsageError
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import as_asset
from meshmark.mesh.charts import Charts
from meshmark.metrics import distortion, texture_drift
from meshmark.metrics.texture import followed_drift
from meshmark.sources.facts import texture_coordinates
from meshmark.sources.reading import read
from meshmark.testing.binned_schemes import swaying
from meshmark.testing.meshes import plane, revolution
from usd_stages import CUBE_COUNTS, CUBE_INDICES, cube, write_text


def up(z: float) -> np.ndarray:
    return np.array([0.0, 0.0, z])


def inner(V: np.ndarray) -> np.ndarray:
    """Tell which vertices of a unit square lie off its border."""
    return np.all((V[:, :2] > 0) & (V[:, :2] < 1), axis=1)


def test_a_slide_on_a_plane_is_its_length_in_texels() -> None:
    V, F = plane(21)
    slide = np.where(inner(V)[:, None], [0.004, 0.003, 0.0], 0.0)
    drift = texture_drift(V, V + slide, F, 0.5 * V[:, :2])
    np.testing.assert_allclose(drift, np.where(inner(V), 0.5 * 0.005 * 4096, 0.0), atol=1e-9)
    again = texture_drift(V, V + slide, F, 0.5 * V[:, :2], texels=1024)
    np.testing.assert_allclose(again, drift / 4)


def test_a_move_out_of_the_surface_costs_nothing() -> None:
    V, F = plane(21)
    assert texture_drift(V, V + up(0.01), F, V[:, :2]).max() < 1e-9
    assert texture_drift(V, V, F, V[:, :2]).max() == 0.0


def wrapped(n_around: int = 40, n_along: int = 30):
    """Return a tube, and coordinates of its corners that wrap round once with a seam.

    Around the seam u falls from 1 back to 0 between two neighbouring columns.
    """
    V, F = revolution(np.ones(n_along), np.linspace(0, 4, n_along), n_around)
    F = F[np.all(n_along * n_around > F, axis=1)]
    u = np.mod(np.arctan2(V[:, 1], V[:, 0]) / (2 * np.pi) + 1e-12, 1.0)[F]
    # The corners of a face that crosses the seam continue beyond 1.
    u = np.where(u < u.max(axis=1, keepdims=True) - 0.5, u + 1.0, u)
    return V, F, np.stack([u, V[F][..., 2] / 4], axis=2)


@pytest.mark.parametrize("step", [0.2, 0.9, 1.6])
def test_a_seam_is_no_drift(step) -> None:
    V, F, UV = wrapped()
    a = step * 2 * np.pi / 40
    R = np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]])
    drift = texture_drift(V, V @ R, F, UV)
    # Vertices slide along chords, and the facets are flat: u goes with the arc but for that.
    used = np.unique(F)
    np.testing.assert_allclose(drift[used], step / 40 * 4096, rtol=0.02)


@pytest.mark.parametrize("step", [0.2, 0.9, 1.6])
def test_coordinates_that_went_along_do_not_drift(step) -> None:
    V, F, UV = wrapped()
    a = step * 2 * np.pi / 40
    R = np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]])
    charts, along = Charts.of_corners(F, UV), np.array([step / 40, 0])
    drift = followed_drift(V, V @ R, charts, UV, UV + along)
    assert drift.max() < 0.02 * step / 40 * 4096
    kept = followed_drift(V, V @ R, charts, UV, UV)
    np.testing.assert_allclose(kept[np.unique(F)], step / 40 * 4096, rtol=0.03)
    wrong = followed_drift(V, V @ R, charts, UV, UV - along)
    np.testing.assert_allclose(wrong[np.unique(F)], 2 * step / 40 * 4096, rtol=0.03)


def test_vertices_of_no_face_do_not_count() -> None:
    V, F = plane(3)
    V = np.concatenate([V, [[9.0, 9, 9]]])
    drift = texture_drift(V, V + up(0.01), F, V[:, :2])
    assert drift[-1] == 0.0


def test_faces_without_area_do_no_harm() -> None:
    V, F = plane(11)
    F = np.concatenate([F, [[0, 0, 1], [12, 13, 14]]])
    slide = np.where(inner(V)[:, None], [0.01, 0.0, 0.0], 0.0)
    drift = texture_drift(V, V + slide, F, V[:, :2])
    np.testing.assert_allclose(drift[inner(V)], 40.96, rtol=1e-6)


def test_coordinates_that_do_not_fit_are_refused() -> None:
    V, F = plane(3)
    with pytest.raises(UsageError, match=r"\(4, 2\) fit neither 9 points nor 8 triangles"):
        texture_drift(V, V, F, np.zeros((4, 2)))


def test_distortion_tells_the_farthest_drift_of_a_frame() -> None:
    V, F = plane(11)
    slide = np.where(inner(V)[:, None], [0.01, 0.0, 0.0], 0.0)
    before = MeshAnimation.from_arrays(np.stack([V, V]), F)
    after = MeshAnimation.from_arrays(np.stack([V + slide, V + 3 * slide]), F)
    found = distortion(before, after, uv=V[:, :2])
    assert found.texture_drift == pytest.approx(0.02 * 4096)
    assert math.isnan(distortion(before, after).texture_drift)


# One corner of the cube's 24 after the other; the middle of each is told by its index alone.
CORNER_UV = np.stack([np.arange(24) / 32, np.arange(24)[::-1] / 64], axis=1)
POINT_UV = np.stack([np.arange(8) / 8, np.arange(8) / 16], axis=1)


def pairs(uv: np.ndarray) -> str:
    return "[" + ", ".join(f"({u:.9g}, {v:.9g})" for u, v in uv.tolist()) + "]"


def primvar(uv: np.ndarray, interpolation: str, name: str = "st", more: str = "") -> str:
    return f'texCoord2f[] primvars:{name} = {pairs(uv)} (interpolation = "{interpolation}")\n{more}'


def uv_of(path, body: str):
    asset = read(write_text(path / "cube.usda", body))
    mesh = asset.meshes[0]
    return texture_coordinates(asset, mesh.prim), mesh[0].faces


def test_coordinates_of_corners_are_read_for_triangles(tmp_path) -> None:
    uv, F = uv_of(tmp_path, cube(more=primvar(CORNER_UV, "faceVarying")))
    # Quads as fans: corners 0 1 2 and 0 2 3 of each.
    corner = np.arange(0, 24, 4)[:, None, None] + [[0, 1, 2], [0, 2, 3]]
    np.testing.assert_allclose(uv, CORNER_UV[corner.reshape(-1, 3)])
    np.testing.assert_array_equal(F, np.array(CUBE_INDICES)[corner.reshape(-1, 3)])


@pytest.mark.parametrize("interpolation", ["vertex", "varying"])
def test_coordinates_of_points_are_read_for_triangles(tmp_path, interpolation) -> None:
    uv, F = uv_of(tmp_path, cube(more=primvar(POINT_UV, interpolation)))
    np.testing.assert_allclose(uv, POINT_UV[F])


def test_indexed_coordinates_are_looked_up(tmp_path) -> None:
    # Corner by corner the index of its point: then they are those of the points.
    indices = f"int[] primvars:st:indices = {CUBE_INDICES}"
    uv, F = uv_of(tmp_path, cube(more=primvar(POINT_UV, "faceVarying", more=indices)))
    np.testing.assert_allclose(uv, POINT_UV[F])


@pytest.mark.parametrize("more", ['uniform token orientation = "leftHanded"', ""])
def test_corners_listed_backwards_keep_their_coordinates(tmp_path, more) -> None:
    mirror = "" if more else "double3 xformOp:scale = (-1, 1, 1)"
    order = "" if more else 'uniform token[] xformOpOrder = ["xformOp:scale"]'
    statements = "\n".join([more, mirror, order])
    uv, F = uv_of(
        tmp_path, cube(more=primvar(POINT_UV[CUBE_INDICES], "faceVarying", "st", more=statements))
    )
    assert F[0].tolist() != CUBE_INDICES[:3]
    np.testing.assert_allclose(uv, POINT_UV[F])


def test_other_names_will_do_but_the_usual_one_is_preferred(tmp_path) -> None:
    other = primvar(POINT_UV[::-1], "vertex", "UVMap")
    uv, F = uv_of(tmp_path, cube(more=other))
    np.testing.assert_allclose(uv, POINT_UV[::-1][F])
    uv, F = uv_of(tmp_path, cube(more=other + primvar(POINT_UV, "vertex")))
    np.testing.assert_allclose(uv, POINT_UV[F])


@pytest.mark.parametrize(
    "more",
    [
        "",
        primvar(POINT_UV[:1], "constant"),
        primvar(POINT_UV[:5], "vertex"),
        primvar(CORNER_UV[:6], "uniform"),
        primvar(POINT_UV, "faceVarying", more="int[] primvars:st:indices = [0, 99]"),
        "float3[] primvars:st = [(0, 0, 0)]",
        "texCoord2f[] primvars:st",
    ],
    ids=["none", "constant", "too few", "uniform", "bad indices", "other type", "no value"],
)
def test_what_cannot_be_used_is_left_out(tmp_path, more) -> None:
    assert uv_of(tmp_path, cube(more=more))[0] is None


def test_only_stages_have_coordinates_for_us() -> None:
    V, F = plane(3)
    assert texture_coordinates(as_asset(MeshAnimation.from_arrays(V, F)), "/") is None


def test_a_manifest_tells_the_drift(tmp_path) -> None:
    frame = swaying(1)[0]
    found = []
    for name in ("plain", "mapped"):
        source = tmp_path / f"{name}.usda"
        stage = Usd.Stage.CreateNew(str(source))
        mesh = UsdGeom.Mesh.Define(stage, "/Dumbbell")
        mesh.CreatePointsAttr(frame.points.astype(np.float32))
        mesh.CreateFaceVertexCountsAttr(frame.topology.counts.astype(np.int32))
        mesh.CreateFaceVertexIndicesAttr(frame.topology.indices.astype(np.int32))
        if name == "mapped":
            type_name = Sdf.ValueTypeNames.TexCoord2fArray
            st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", type_name, UsdGeom.Tokens.vertex)
            st.Set((frame.points[:, :2] / 8).astype(np.float32))
        stage.GetRootLayer().Save()
        output = tmp_path / f"{name}-marked.usda"
        for primvars in ("keep", "follow"):
            manifest = mark_file(
                source, output, Key(bytes(32)), recipe=Recipe("cho2007"), primvars=primvars
            )
            assert manifest["primvars"] == primvars
            found.append(manifest["prims"][0]["distortion"])
    plain, _, mapped, followed = found
    assert followed["texture_drift"] < 0.02 * mapped["texture_drift"]
    assert plain["texture_drift"] is None
    assert plain["jitter"] is None
    # Seen along z, the texture moves at most as far as its vertex does.
    F = frame.faces
    edge = np.linalg.norm(frame.points[F] - frame.points[np.roll(F, 1, axis=1)], axis=2)
    longest = mapped["max_move_edges"] * edge.max() / 8 * 4096
    assert 0.0 < mapped["texture_drift"] < longest


assert len(CUBE_COUNTS) * 4 == len(CUBE_INDICES) == len(CORNER_UV)
