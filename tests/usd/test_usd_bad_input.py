"""Bad input: an error that says where, nothing on stderr, never a traceback of pxr."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf

from folders import FAULTS
from meshmark.errors import InputError, UsageError
from meshmark.mesh.checks import check
from meshmark.usd.checking import check_stage
from meshmark.usd.reading import read_stage
from usd_stages import CUBE_POINTS, array, cube, read_one, sampled, write_text


def refused(source: str, capfd: pytest.CaptureFixture[str]) -> InputError:
    with pytest.raises(InputError) as caught:
        check(read_one(source))
    assert str(caught.value).startswith(f"{source}: ")
    assert "\n" not in str(caught.value)
    assert capfd.readouterr().err == ""
    return caught.value


def test_missing_file(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert refused(str(tmp_path / "none.usd"), capfd).message == "no such file"


def test_folder(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert refused(str(tmp_path), capfd).message == "not a file"


@pytest.mark.parametrize("name", ["a.usd", "a.usda", "a.usdc", "a.usdz", "a.png"])
@pytest.mark.parametrize("content", [b"", b"hello", b'#usda 1.0\ndef Mesh "a" {'])
def test_not_usd(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str, content: bytes
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    assert "not readable as USD" in refused(str(path), capfd).message


@pytest.mark.parametrize("kept", [0.0, 0.001, 0.3, 0.9, 0.9999])
def test_truncated_crate(tmp_path: Path, capfd: pytest.CaptureFixture[str], kept: float) -> None:
    frames = {time: CUBE_POINTS + time for time in range(20)}
    text = write_text(tmp_path / "a.usda", cube(points=sampled(frames)))
    whole = tmp_path / "whole.usdc"
    Sdf.Layer.FindOrOpen(text).Export(str(whole))
    broken = tmp_path / "broken.usdc"
    broken.write_bytes(whole.read_bytes()[: int(kept * whole.stat().st_size)])
    assert "not readable as USD" in refused(str(broken), capfd).message


def test_no_mesh(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    source = write_text(tmp_path / "a.usda", 'def Xform "a"\n{\n}')
    assert refused(source, capfd).message == "the stage holds no mesh"


BAD_MESHES = {
    "no points": ('def Mesh "m"\n{\n}', "no points", None),
    "empty points": (cube("m", "point3f[] points = []"), "no points", None),
    "nan": (
        cube("m", sampled({1: CUBE_POINTS, 2: np.where(CUBE_POINTS == 1, np.nan, 0)})),
        "point 1 is not finite",
        2.0,
    ),
    "inf": (
        cube("m", sampled({1: CUBE_POINTS, 4.5: np.where(CUBE_POINTS == 1, np.inf, 0)})),
        "point 1 is not finite",
        4.5,
    ),
    "index out of range": (
        cube("m", f"point3f[] points = {array(CUBE_POINTS[:5])}"),
        "index 7 is out of range for 5 points",
        None,
    ),
    "zero faces": (
        f'def Mesh "m"\n{{\npoint3f[] points = {array(CUBE_POINTS)}\n}}',
        "no faces",
        None,
    ),
    "more points later": (
        cube(
            "m",
            sampled(
                {0: np.concatenate([CUBE_POINTS, CUBE_POINTS])}
                | dict.fromkeys(range(1, 12), CUBE_POINTS)
            ),
        ),
        "16 points here but 8 at most times",
        0.0,
    ),
    "blocked sample": (
        cube("m", f"point3f[] points.timeSamples = {{ 1: {array(CUBE_POINTS)}, 2: None }}"),
        "no points",
        2.0,
    ),
}


@pytest.mark.parametrize("name", BAD_MESHES)
def test_bad_mesh(tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str) -> None:
    body, message, time = BAD_MESHES[name]
    source = write_text(tmp_path / "bad.usda", body)
    error = refused(source, capfd)
    assert message in error.message
    assert error.prim == "/m"
    where = np.nan if error.time is None else error.time
    np.testing.assert_equal(where, np.nan if time is None else time)


def test_a_bad_mesh_beside_a_good_one(tmp_path: Path) -> None:
    body = cube("good") + cube("bad", "point3f[] points = []")
    source = write_text(tmp_path / "a.usda", body)
    asset = read_stage(source)
    assert [mesh.prim for mesh in asset.meshes] == ["/good"]
    assert asset.notes == ("/bad: left out: the mesh has no points",)
    assert len(read_stage(source, ["/good"]).meshes) == 1
    with pytest.raises(InputError, match="/bad: the mesh has no points"):
        read_stage(source, ["/good", "/bad"])


def test_a_wanted_mesh_that_is_not_there(tmp_path: Path) -> None:
    source = write_text(tmp_path / "a.usda", cube())
    with pytest.raises(UsageError, match="no mesh at /none; there is /cube"):
        read_stage(source, ["/none"])


# What is wrong with clips shows when pxr first needs them, long after the stage is open.
CLIPS = """
    def Mesh "A" (clips = {{ dictionary default = {{
        asset[] assetPaths = [@{clip}@]
        asset manifestAssetPath = @{manifest}@
        string primPath = "/A"
        double2[] active = [(1, 0)]
    }} }})
    {{
    }}
"""


@pytest.mark.parametrize("clip", ["bad.usda", "gone.usda", "late.usda"])
@pytest.mark.parametrize("manifest", ["bad.usda", "gone.usda"])
def test_what_shows_late(
    tmp_path: Path, clip: str, manifest: str, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bad.usda").write_text("this is no layer")
    body = CLIPS.format(clip=clip, manifest=manifest)
    refused(write_text(tmp_path / "late.usda", body), capfd)


@pytest.mark.parametrize(
    "rates", ["0 24", "24 0", "inf 24", "24 -inf", "nan 24", "24 nan", "1e-300 1e300"]
)
@pytest.mark.parametrize("how", ["subLayers = [@./body.usda@]", "references"])
def test_times_that_do_not_convert(
    tmp_path: Path, rates: str, how: str, capfd: pytest.CaptureFixture[str]
) -> None:
    own, other = rates.split()
    moving = cube("m", points=sampled({1: CUBE_POINTS, 2: CUBE_POINTS + 1}))
    write_text(tmp_path / "body.usda", moving, f"timeCodesPerSecond = {other}")
    body = 'def "m" (references = @./body.usda@</m>) {}' if how == "references" else ""
    metadata = f"timeCodesPerSecond = {own}\n" + ("" if body else how)
    error = refused(write_text(tmp_path / "still.usda", body, metadata), capfd)
    assert "timeCodesPerSecond" in error.message


@pytest.mark.parametrize("rate", ["0", "-24", "inf", "nan"])
def test_times_that_need_no_conversion(tmp_path: Path, rate: str) -> None:
    moving = cube("m", points=sampled({1: CUBE_POINTS, 2: CUBE_POINTS + 1}))
    source = write_text(tmp_path / "body.usda", moving, f"timeCodesPerSecond = {rate}")
    assert read_one(source).times.tolist() == [1.0, 2.0]


def test_a_value_of_a_type_that_no_attribute_has_is_refused() -> None:
    """A damaged binary layer: in Python, usd-core hands such a value to nobody."""
    source = str(FAULTS / "odd-values/no_such_type.usdc")
    with pytest.raises(InputError, match="a value is of a type that no attribute has") as caught:
        check_stage(source, ())
    assert str(caught.value).startswith(f"{source}: ")
