"""What must not be written: over a source, half of a file, nonsense."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from meshmark.errors import MeshmarkError, OutputError, UsageError
from meshmark.mesh.animation import Frame
from meshmark.mesh.asset import Asset
from meshmark.usd.delivery import write_flattened
from meshmark.usd.reading import read_stage
from meshmark.usd.writing import write_override
from usd_stages import FRAMES, cube, digest, infinite, moved, sampled, write_text


def test_the_source_is_never_overwritten(tmp_path: Path) -> None:
    write_text(tmp_path / "base.usda", cube())
    source = write_text(tmp_path / "a.usda", "", "subLayers = [@base.usda@]")
    original = read_stage(source)
    (tmp_path / "link.usda").symlink_to(tmp_path / "base.usda")
    for name in ("a.usda", "base.usda", "link.usda"):
        before = digest(tmp_path / name)
        with pytest.raises(OutputError, match="part of the source"):
            write_override(original, moved(original), tmp_path / name)
        assert digest(tmp_path / name) == before


NUL = "\0\0ne"
NAMING_NO_FILE = {
    "reference": f'def "V" (references = @{NUL}.usda@)\n{{\n}}',
    "payload": f'def "V" (payload = @./{NUL}.usda@)\n{{\n}}',
    "identifier": f'def "V" (assetInfo = {{ asset identifier = @{NUL}.usda@ }})\n{{\n}}',
    "texture": f'def "V"\n{{\nasset a = @/{NUL}/a.png@\n}}',
    "tiles": f'def "V"\n{{\nasset a = @/{NUL}/a.<UDIM>.png@\n}}',
}


@pytest.mark.parametrize("write", [write_override, write_flattened])
@pytest.mark.parametrize("in_variant", [True, False])
@pytest.mark.parametrize("kind", NAMING_NO_FILE)
def test_a_name_that_no_file_can_have_is_in_nobodys_way(
    tmp_path: Path,
    kind: str,
    in_variant: bool,
    write: Callable[[Asset, Asset, Path], object],
) -> None:
    body = NAMING_NO_FILE[kind]
    if in_variant:
        body = f'def "A"\n{{\nvariantSet "look" = {{\n"one" {{\n{body}\n}}\n}}\n}}'
    source = tmp_path / "a.usda"
    source.write_bytes(f"#usda 1.0\n{body}\n{cube()}".encode())
    original = read_stage(str(source))
    write(original, moved(original), tmp_path / "o.usda")
    assert [mesh.prim for mesh in read_stage(str(tmp_path / "o.usda")).meshes] == ["/cube"]


def broken(frame: Frame) -> Frame:
    if frame.time == 2:
        raise ZeroDivisionError
    return frame


def halved(frame: Frame) -> Frame:
    return frame.moved(frame.points[:4]) if frame.time == 2 else frame


@pytest.mark.parametrize(
    ("function", "error"),
    [(broken, ZeroDivisionError), (halved, UsageError), (infinite, OutputError)],
)
def test_nothing_half_written_is_left(
    tmp_path: Path, function: type[Frame], error: type[Exception]
) -> None:
    original = read_stage(write_text(tmp_path / "a.usda", cube(points=sampled(FRAMES))))
    marked = replace(original, meshes=(original.meshes[0].map(function),))
    output = tmp_path / "o.usdc"
    output.write_text("what was there before")
    with pytest.raises(error) as caught:
        write_override(original, marked, output)
    assert output.read_text() == "what was there before"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.usda", "o.usdc"]
    if isinstance(caught.value, MeshmarkError):
        assert (caught.value.prim, caught.value.time) == ("/cube", 2)


def test_impossible_places(tmp_path: Path) -> None:
    original = read_stage(write_text(tmp_path / "a.usda", cube()))
    with pytest.raises(OutputError, match="No such file"):
        write_override(original, moved(original), tmp_path / "none" / "o.usda")
    with pytest.raises(UsageError, match="must end in"):
        write_override(original, moved(original), tmp_path / "o.abc")
    (tmp_path / "folder.usda").mkdir()
    with pytest.raises(OutputError, match="cannot be written"):
        write_override(original, moved(original), tmp_path / "folder.usda")


def test_frames_and_prims_the_source_does_not_have(tmp_path: Path) -> None:
    original = read_stage(write_text(tmp_path / "a.usda", cube(points=sampled(FRAMES))))
    mesh = original.meshes[0]
    late = replace(original, meshes=(replace(mesh, times=mesh.times + 0.25),))
    with pytest.raises(UsageError, match="no points at time"):
        write_override(original, late, tmp_path / "o.usda")
    lost = replace(original, meshes=(replace(mesh, prim="/none"),))
    with pytest.raises(UsageError, match="no such prim"):
        write_override(original, lost, tmp_path / "o.usda")
