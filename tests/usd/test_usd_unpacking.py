"""Files out of strangers' packages: below the folder beside the deliverable, or nowhere."""

from __future__ import annotations

import stat
import zipfile
from pathlib import Path

import pytest
from pxr import Sdf, Usd, UsdUtils

from meshmark.errors import OutputError
from meshmark.usd.delivery import write_flattened
from meshmark.usd.reading import read_stage
from usd_stages import cube, moved, write_text


def package(path: Path, *members: str | zipfile.ZipInfo, kind: int = zipfile.ZIP_STORED) -> None:
    with zipfile.ZipFile(path, "w", kind) as archive:
        archive.writestr("inner.usda", '#usda 1.0\ndef Xform "X"\n{\n}\n')
        for member in members:
            name = member if isinstance(member, str) else member.filename
            archive.writestr(member, f"pixels of {name}" * 50)


def stage_with(tmp_path: Path, *assets: str) -> str:
    textures = "\n".join(f"asset inputs:t{i} = @{path}@" for i, path in enumerate(assets))
    return write_text(tmp_path / "scene.usda", cube() + f'def Shader "s"\n{{\n{textures}\n}}')


def deliver(source: str, output: Path) -> Usd.Stage:
    original = read_stage(source)
    write_flattened(original, moved(original), output)
    return Usd.Stage.Open(str(output))


def assert_refused(tmp_path: Path, source: str, reason: str) -> None:
    (tmp_path / "out").mkdir()
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(OutputError, match=reason):
        deliver(source, tmp_path / "out" / "o.usdc")
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    "name",
    [
        "{absolute}",
        "../../victim.png",
        "tex/../../../victim.png",
        "..\\..\\victim.png",
        "C:\\victim.png",
        "C:/victim.png",
        "C:victim.png",
        "\\\\server\\share\\victim.png",
        "tex//victim.png",
        "./victim.png",
        "CON",
        "tex/nul.png",
        "com1.tex.png",
        "LPT9 .png",
        "tex/.. /victim.png",
        "victim.png.",
        "a.png:stream",
        "v" * 256,
        "/".join(["deep"] * 300),
    ],
)
def test_names_that_could_lead_out_are_refused(tmp_path: Path, name: str) -> None:
    name = name.format(absolute=tmp_path / "victim.png")
    package(tmp_path / "tex.usdz", name)
    assert_refused(tmp_path, stage_with(tmp_path, f"./tex.usdz[{name}]"), "forbidden|cannot")


def test_names_that_differ_by_case_only_are_refused(tmp_path: Path) -> None:
    package(tmp_path / "tex.usdz", "tex/a.png", "Tex/A.png")
    source = stage_with(tmp_path, "./tex.usdz[tex/a.png]", "./tex.usdz[Tex/A.png]")
    assert_refused(tmp_path, source, "one name")


def test_links_are_refused(tmp_path: Path) -> None:
    link = zipfile.ZipInfo("a.png")
    link.create_system = 3
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    package(tmp_path / "tex.usdz", link)
    assert_refused(tmp_path, stage_with(tmp_path, "./tex.usdz[a.png]"), "no plain file")


def test_bombs_are_refused(tmp_path: Path) -> None:
    package(tmp_path / "tex.usdz", "a.png", kind=zipfile.ZIP_DEFLATED)
    assert_refused(tmp_path, stage_with(tmp_path, "./tex.usdz[a.png]"), "compressed")


def test_names_that_share_their_bytes_are_refused(tmp_path: Path) -> None:
    names = [f"{i}.png" for i in range(9)]
    with zipfile.ZipFile(tmp_path / "tex.usdz", "w") as archive:
        archive.writestr("inner.usda", "#usda 1.0\n")
        archive.writestr("0.png", b"x" * 100_000)
        whole = archive.getinfo("0.png")
        for name in names[1:]:
            twin = zipfile.ZipInfo(name)
            twin.file_size = twin.compress_size = whole.file_size
            twin.header_offset, twin.CRC = whole.header_offset, whole.CRC
            archive.filelist.append(twin)
            archive.NameToInfo[name] = twin
    source = stage_with(tmp_path, *(f"./tex.usdz[{name}]" for name in names))
    assert_refused(tmp_path, source, "larger than itself|cannot be copied")


def test_archives_that_are_no_package_are_left_alone(tmp_path: Path) -> None:
    # Or a path in a vendor's file could fetch what only the user may read.
    package(tmp_path / "private.zip", "letter.txt")
    source = stage_with(tmp_path, f"{tmp_path}/private.zip[letter.txt]")
    assert_refused(tmp_path, source, "is no package")


def test_files_of_two_packages_do_not_meet(tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        package(tmp_path / name / "tex.usdz", f"{name}.png", "0/a.png")
    source = stage_with(tmp_path, "./one/tex.usdz[0/a.png]", "./two/tex.usdz[0/a.png]")
    stage = deliver(source, tmp_path / "o.usda")
    places = [stage.GetAttributeAtPath(f"/s.inputs:t{i}").Get().path for i in range(2)]
    assert places == ["./o.usda.assets/1/0/a.png", "./o.usda.assets/2/0/a.png"]
    assert all((tmp_path / place).is_file() for place in places)


def test_a_package_within_a_package(tmp_path: Path) -> None:
    write_text(
        tmp_path / "inner.usda",
        cube() + 'def Shader "tex"\n{\nasset inputs:file = @./a.png@\n}',
        'defaultPrim = "cube"',
    )
    (tmp_path / "a.png").write_bytes(b"pixels")
    inner, outer = tmp_path / "inner.usdz", tmp_path / "outer.usdz"
    assert UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(tmp_path / "inner.usda")), str(inner))
    with zipfile.ZipFile(outer, "w") as archive:
        archive.writestr("scene.usda", "#usda 1.0\n(\nsubLayers = [@./inner.usdz@]\n)\n")
        # USD maps what it reads: data begin at multiples of 64 bytes.
        used = archive.fp.tell() + 30 + len("inner.usdz")
        archive.writestr("pad", b" " * ((-used - 33) % 64))
        archive.write(inner, "inner.usdz")
    for path in (tmp_path / "inner.usda", tmp_path / "a.png", inner):
        path.unlink()
    output = tmp_path / "o.usdc"
    stage = deliver(str(outer), output)
    outer.unlink()
    resolved = stage.GetAttributeAtPath("/tex.inputs:file").Get().resolvedPath
    assert Path(resolved).read_bytes() == b"pixels"


def test_tiles_of_a_package(tmp_path: Path) -> None:
    package(tmp_path / "tex.usdz", "t/a.1001.png", "t/a.1002.png", "t/a.png")
    stage = deliver(stage_with(tmp_path, "./tex.usdz[t/a.<UDIM>.png]"), tmp_path / "o.usda")
    path = stage.GetAttributeAtPath("/s.inputs:t0").Get().path
    assert path == "./o.usda.assets/1/t/a.<UDIM>.png"
    copied = sorted(file.name for file in (tmp_path / "o.usda.assets").rglob("*.png"))
    assert copied == ["a.1001.png", "a.1002.png"]


def test_tiles_without_a_leading_dot_are_anchored(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    tiles = """
    def Shader "s"
    {
        asset inputs:one = @tex/b.<UDIM>.png@
        asset[] inputs:many = [@tex/b.<UDIM>.png@, @none/b.<UDIM>.png@]
        asset inputs:sampled.timeSamples = { 1: @tex/b.<UDIM>.png@ }
    }
    """
    write_text(
        folder / "deep" / "model.usda", f'def Xform "M"\n{{{cube()}{tiles}}}', 'defaultPrim = "M"'
    )
    (folder / "deep" / "tex").mkdir()
    (folder / "deep" / "tex" / "b.1001.png").write_bytes(b"pixels")
    source = write_text(folder / "scene.usda", 'def "m" (references = @deep/model.usda@)\n{\n}')
    stage = deliver(source, tmp_path / "o.usda")
    anchored = "./in/deep/tex/b.<UDIM>.png"
    assert stage.GetAttributeAtPath("/m/s.inputs:one").Get().path == anchored
    many = stage.GetAttributeAtPath("/m/s.inputs:many").Get()
    assert [each.path for each in many] == [anchored, "none/b.<UDIM>.png"]
    assert stage.GetAttributeAtPath("/m/s.inputs:sampled").Get(1).path == anchored


def test_a_folder_is_replaced_whole_or_not_at_all(tmp_path: Path) -> None:
    package(tmp_path / "tex.usdz", "a.png")
    source = stage_with(tmp_path, "./tex.usdz[a.png]")
    output = tmp_path / "o.usda"
    folder = tmp_path / "o.usda.assets"
    folder.mkdir()
    (folder / "stale.png").write_bytes(b"of another delivery")
    deliver(source, output)
    assert [path.name for path in folder.rglob("*.png")] == ["a.png"]
    output.unlink()
    output.mkdir()
    (output / "in the way").write_bytes(b"")
    (folder / "kept.png").write_bytes(b"")
    with pytest.raises(OutputError):
        deliver(source, output)
    assert sorted(path.name for path in folder.rglob("*.png")) == ["a.png", "kept.png"]
    assert not list(tmp_path.glob(".meshmark*"))
