"""What a stage lacks, and what it holds that is not looked at: never passed over in silence."""

from __future__ import annotations

from pathlib import Path

import pytest

from meshmark import read, write
from meshmark.errors import InputError
from meshmark.usd.reading import read_stage
from usd_stages import CUBE_POINTS, cube, moved, sampled, write_text

EMPTY = 'def Xform "A"'
CLIPPED = """
def Xform "H" (
    prepend references = @./faces.usda@</H>
    clips = {
        dictionary default = {
            string primPath = "/H"
            asset[] assetPaths = [@./gone.usdc@]
            double2[] active = [(1, 0)]
            double2[] times = [(1, 1), (6, 6)]
        }
    }
)
{
}
"""
LACKING = {
    "reference": f"{EMPTY} (references = @./gone.usdc@)\n{{\n}}",
    "reference to a prim": f"{EMPTY} (references = @./gone.usdc@</B>)\n{{\n}}",
    "payload": f"{EMPTY} (payload = @./gone.usdc@)\n{{\n}}",
    "clip": CLIPPED,
    "sublayer": "",
}


@pytest.fixture
def faces(tmp_path: Path) -> None:
    body = cube("body", points="point3f[] points")
    write_text(tmp_path / "faces.usda", f'def Xform "H"\n{{{body}}}')


@pytest.mark.usefixtures("faces")
@pytest.mark.parametrize("kind", LACKING)
def test_the_layer_that_is_missing_is_named(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], kind: str
) -> None:
    metadata = "subLayers = [@./gone.usdc@]" if kind == "sublayer" else ""
    alone = write_text(tmp_path / "alone.usda", LACKING[kind], metadata)
    with pytest.raises(InputError, match=r"; could not open \S*gone\.usdc$") as caught:
        read_stage(alone)
    assert str(caught.value).startswith(alone)
    beside = write_text(tmp_path / "beside.usda", LACKING[kind] + cube("body"), metadata)
    asset = read_stage(beside)
    assert [mesh.prim for mesh in asset.meshes] == ["/body"]
    assert any("gone.usdc" in note for note in asset.notes)
    assert capfd.readouterr().err == ""


def test_what_is_no_mesh_or_not_shown_is_counted(tmp_path: Path) -> None:
    others = "".join(
        f'def {kind} "{kind}{i}"\n{{\n}}\n'
        for kind, n in {"Points": 2, "BasisCurves": 1, "Sphere": 1, "PointInstancer": 1}.items()
        for i in range(n)
    )
    hidden = cube("a", kind="class") + cube("b", kind="over") + cube("c", kind="class")
    dead = cube("dead").replace('"dead"', '"dead" ( active = false )')
    source = write_text(tmp_path / "a.usda", cube() + others + hidden + dead)
    assert read_stage(source).notes == (
        "not looked at: 1 BasisCurves, 2 Mesh (class), 1 Mesh (deactivated), 1 Mesh (over), "
        "1 PointInstancer, 2 Points, 1 Sphere",
    )
    assert read_stage(write_text(tmp_path / "b.usda", cube())).notes == ()


def test_purpose_and_visibility_are_told_of_each_mesh(tmp_path: Path) -> None:
    body = f"""
    def Xform "hidden"
    {{
        token visibility = "invisible"
        {cube("a")}
        {cube("b", more='uniform token purpose = "proxy"')}
    }}
    {cube("c", more='uniform token purpose = "render"')}
    {cube("d", more='token visibility.timeSamples = {{ 1: "invisible", 2: "inherited" }}')}
    {cube("e")}
    """.replace("{{", "{").replace("}}", "}")
    asset = read_stage(write_text(tmp_path / "a.usda", body))
    assert {mesh.prim: mesh.notes for mesh in asset.meshes} == {
        "/hidden/a": ("invisible at its first time",),
        "/hidden/b": ("purpose proxy", "invisible at its first time"),
        "/c": ("purpose render",),
        "/d": ("invisible at its first time",),
        "/e": (),
    }


@pytest.mark.parametrize("deliver", [False, True])
def test_what_pxr_says_of_it_while_writing_is_silenced(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], deliver: bool
) -> None:
    clips = """(clips = { dictionary default = {
        asset[] assetPaths = [@./clip.usda@]
        asset manifestAssetPath = @./gone.usda@
        string primPath = "/body"
        double2[] active = [(1, 0)]
    } })"""
    write_text(tmp_path / "clip.usda", cube("body", points=sampled({1: CUBE_POINTS}), kind="over"))
    body = cube("body").replace('"body"', f'"body" {clips}')
    source = write_text(tmp_path / "s.usda", body)
    # Another process reads: in this one, pxr has not seen the stage before it writes.
    asset = read(source, isolated=True)
    assert any("gone.usda" in note for note in asset.notes)
    write(moved(asset), asset, tmp_path / "o.usda", deliver=deliver)
    assert capfd.readouterr().err == ""
