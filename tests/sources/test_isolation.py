"""Files made to crash, hang or exhaust their reader cost a process of its own, and one line."""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rogue_reader import install

from folders import FAULTS
from meshmark.cli import main
from meshmark.errors import InputError, UsageError
from meshmark.files.temporary import ScratchFolder
from meshmark.keys import Key
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.skinning import Skinning
from meshmark.sources.digests import source_digests
from meshmark.sources.facts import texture_coordinates
from meshmark.sources.isolation import process as processes
from meshmark.sources.isolation import reading
from meshmark.sources.isolation.reading import read_isolated
from meshmark.sources.reading import read
from meshmark.testing.meshes import icosphere
from rigged_stages import bent_tube
from usd_stages import CUBE_POINTS, cube, nested_references, sampled, write_text

CRASHING = FAULTS / "crate-crash" / "usdc.1.205.usdc"
SEED = 7
MOVING = {1: CUBE_POINTS, 2: CUBE_POINTS + 1, 4.5: CUBE_POINTS * 2}


@pytest.fixture(autouse=True)
def scratch(tmp_path, monkeypatch) -> Path:
    """Return the folder of temporary files, which is to be empty in the end."""
    folder = tmp_path / "scratch"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    monkeypatch.setenv("TMPDIR", str(folder))
    return folder


@pytest.fixture
def hasty(monkeypatch) -> None:
    """Let reading take little time."""
    monkeypatch.setenv("MESHMARK_READ_SECONDS", "1.5")


@pytest.fixture
def rogue(tmp_path, monkeypatch):
    """Return a function that makes a source which the rogue reader does something with."""
    site = tmp_path / "site"
    site.mkdir()
    install(site)
    monkeypatch.syspath_prepend(site)

    def make(deed: str) -> Path:
        path = tmp_path / f"{deed}.rogue"
        path.write_text("a source", "utf-8")
        return path

    return make


def textured(folder: Path) -> str:
    corners = "(0,0), (1,0), (1,1), (0,1), (0,0), (1,0), (1,1), (0,1)"
    st = f'texCoord2f[] primvars:st = [{corners}] (interpolation = "vertex")'
    return write_text(folder / "textured.usda", cube("m", more=st), 'upAxis = "Z"')


def with_bad_frame(folder: Path) -> str:
    spoilt = {**MOVING, 2: np.where(CUBE_POINTS > 0, np.nan, CUBE_POINTS)}
    shown = sampled(spoilt)
    guide = cube("g", more='uniform token purpose = "guide"')
    return write_text(folder / "bad.usda", cube("m", points=shown) + guide)


def changing_faces(folder: Path) -> str:
    V, F = icosphere(1)
    for t in range(3):
        lines = [f"v {x} {y} {z}" for x, y, z in (V * (t + 1)).tolist()]
        lines += [f"f {a} {b} {c}" for a, b, c in (F[t:] + 1).tolist()]
        (folder / f"ball.{t}.obj").write_text("\n".join(lines) + "\n")
    return str(folder / "ball.*.obj")


def rigged(folder: Path) -> str:
    return bent_tube(folder / "arm.usda")


@pytest.mark.parametrize("make", [textured, with_bad_frame, changing_faces, rigged])
def test_what_is_read_apart_is_what_is_read_here(tmp_path, scratch, make) -> None:
    source = make(tmp_path)
    apart, here = read(source, isolated=True), read(source)
    assert_same(apart, here)
    # Worker processes get them pickled.
    assert_same(pickle.loads(pickle.dumps(apart)), here)
    assert source_digests(apart) == source_digests(here)
    mesh = apart.meshes[0]
    del apart
    assert mesh[0].points.size
    assert list(scratch.iterdir())
    del mesh
    assert not list(scratch.iterdir())


def assert_same(apart: Asset, here: Asset) -> None:
    for item in fields(Asset):
        if item.name not in ("meshes", "facts"):
            np.testing.assert_equal(getattr(apart, item.name), getattr(here, item.name), item.name)
    assert len(apart.meshes) == len(here.meshes)
    for mine, other in zip(apart.meshes, here.meshes, strict=True):
        for item in fields(MeshAnimation):
            if item.name != "source":
                np.testing.assert_equal(getattr(mine, item.name), getattr(other, item.name))
        for index in range(len(other)):
            assert_same_frame(mine, other, index)
        assert_same_skinning(mine.skinning, other.skinning)


def assert_same_skinning(mine: Skinning | None, other: Skinning | None) -> None:
    assert (mine is None) == (other is None)
    if mine is not None and other is not None:
        for item in fields(Skinning):
            np.testing.assert_array_equal(getattr(mine, item.name), getattr(other, item.name))


def assert_same_frame(mine: MeshAnimation, other: MeshAnimation, index: int) -> None:
    (found, said), (expected, told) = outcome(mine, index), outcome(other, index)
    assert said == told
    if expected is None or found is None:
        return
    np.testing.assert_equal(found.time, expected.time)
    np.testing.assert_array_equal(found.points, expected.points)
    assert found.topology.same_as(expected.topology)


def outcome(mesh: MeshAnimation, index: int) -> tuple[Frame | None, str]:
    try:
        return mesh[index], ""
    except InputError as error:
        return None, f"{type(error)} {error}"


def test_a_bad_frame_is_there_among_those_that_are_compared(tmp_path) -> None:
    with pytest.raises(InputError, match="finite"):
        read_isolated(with_bad_frame(tmp_path)).meshes[0][1]


def test_textures_are_read_where_they_are_asked_for(tmp_path) -> None:
    source = textured(tmp_path)
    expected = texture_coordinates(read(source), "/m")
    assert expected is not None
    found = texture_coordinates(read_isolated(source, textures=True), "/m")
    np.testing.assert_array_equal(found, expected)
    assert texture_coordinates(read_isolated(source), "/m") is None


def test_wanted_meshes_only(tmp_path) -> None:
    source = write_text(tmp_path / "two.usda", cube("a") + cube("b"))
    assert [mesh.prim for mesh in read_isolated(source, ["/b"]).meshes] == ["/b"]
    with pytest.raises(UsageError, match="no mesh at /c; there is /a, /b"):
        read_isolated(source, ["/c"])


def test_names_of_any_kind(tmp_path) -> None:
    source = write_text(tmp_path / "-é '.usda", cube("a"))
    assert read_isolated(source).source == source
    with pytest.raises(InputError, match="no such file"):
        read_isolated(tmp_path / "none.usda")


DEEDS = {
    "abort": rf"crashes its reader \(signal {int(signal.SIGABRT)}\)",
    "hang": "gets nowhere in 1.5 s; MESHMARK_READ_SECONDS",
    "leave": "ended with 7",
    "allocate": "more than 0.5 GB of memory to read; MESHMARK_READ_MEMORY",
    "exchange": "changed while it was read",
}


@pytest.mark.skipif(os.name != "posix", reason="limits and signals")
@pytest.mark.parametrize("deed", DEEDS)
def test_a_reader_led_astray(rogue, monkeypatch, scratch, deed) -> None:
    # How long memory takes to fill depends on the machine; how long a hang lasts does not.
    if deed == "hang":
        monkeypatch.setenv("MESHMARK_READ_SECONDS", "1.5")
    monkeypatch.setenv("MESHMARK_READ_MEMORY", "0.5")
    with pytest.raises(InputError, match=rf"{deed}\.rogue: .*{DEEDS[deed]}"):
        read_isolated(rogue(deed))
    assert not list(scratch.iterdir())


@pytest.mark.slow
def test_a_long_animation_may_take_long(rogue, hasty) -> None:
    start = time.monotonic()
    asset = read_isolated(rogue("slow"))
    assert time.monotonic() - start > 4.0
    assert len(asset.meshes[0]) == 20
    assert asset.notes == ("read by a rogue",)
    assert asset.meshes[0].notes == ("é",)


def test_one_spoilt_frame_spoils_no_other(rogue) -> None:
    [mesh] = read_isolated(rogue("spoilt")).meshes
    assert mesh[0].points.shape == mesh[2].points.shape
    for _ in range(2):
        with pytest.raises(InputError, match="is spoilt") as raised:
            mesh[1]
        assert raised.value.time == 1.0


@pytest.mark.skipif(os.name != "posix", reason="limits")
def test_frames_without_end_do_not_fill_the_disk(rogue, monkeypatch, scratch) -> None:
    monkeypatch.setenv("MESHMARK_READ_DISK", "0.1")
    with pytest.raises(InputError, match=r"more than 0\.1 GB; MESHMARK_READ_DISK"):
        read_isolated(rogue("large"))
    assert not list(scratch.iterdir())


def test_a_bug_stays_one(rogue) -> None:
    with pytest.raises(RuntimeError, match="AssertionError: of its own making"):
        read_isolated(rogue("bug"))


@pytest.mark.parametrize("value", ["0", "-1", "nan", "inf", "much", ""])
def test_limits_make_sense(monkeypatch, value) -> None:
    monkeypatch.setenv("MESHMARK_READ_MEMORY", value)
    with pytest.raises(UsageError, match="MESHMARK_READ_MEMORY must be a positive number"):
        read_isolated("any.usda")


def test_a_stage_that_multiplies_itself(tmp_path, hasty) -> None:
    source = write_text(tmp_path / "laugh.usda", nested_references(24))
    with pytest.raises(InputError, match=r"laugh\.usda: reading it gets nowhere"):
        read_isolated(source)


def test_what_takes_all_memory_of_a_library_that_does_not_look(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("MESHMARK_READ_MEMORY", "0.2")
    source = write_text(tmp_path / "laugh.usda", nested_references(24))
    with pytest.raises(InputError, match="MESHMARK_READ_MEMORY"):
        read_isolated(source)


MEDDLING = {
    "no report": lambda report: None,
    "a list": lambda report: [],
    "no meshes": lambda report: report["asset"].pop("meshes"),
    "a mesh of text": lambda report: report["asset"].update(meshes=["m"]),
    "times elsewhere": lambda report: report["asset"]["meshes"][0].update(times=1 << 40),
    "times before": lambda report: report["asset"]["meshes"][0].update(times=-8),
    "a table of nothing": lambda report: report["asset"]["meshes"][0].update(table=0),
    "many frames": lambda report: report["asset"]["meshes"][0].update(frames=1 << 60),
    "less than no frames": lambda report: report["asset"]["meshes"][0].update(frames=-1),
    "no topologies": lambda report: report["asset"]["meshes"][0].update(topologies=0),
    "a strange error": lambda report: report["asset"]["meshes"][0].update(
        failed={"0": {"kind": "annotations", "message": "", "source": "", "prim": "", "time": 0}}
    ),
    "an error elsewhere": lambda report: report["asset"]["meshes"][0].update(
        failed={"99": {"kind": "InputError", "message": "", "source": "", "prim": "", "time": 0}}
    ),
    "joints elsewhere": lambda report: report["asset"]["meshes"][0].update(
        skinned=[0, 0, 1 << 40, 8, 2]
    ),
    "joints of other points": lambda report: report["asset"]["meshes"][0].update(
        skinned=[0, 0, 0, 3, 1]
    ),
    "joints without end": lambda report: report["asset"]["meshes"][0].update(
        skinned=[0, 0, 0, 8, 1 << 60]
    ),
    "joints of text": lambda report: report["asset"]["meshes"][0].update(skinned=["a"] * 5),
    "a unit of text": lambda report: report["asset"].update(meters_per_unit="long"),
    "files without hashes": lambda report: report.update(files=[["a"]]),
}


@pytest.fixture(scope="module")
def left_behind(tmp_path_factory) -> Path:
    """Return what the reading process leaves of a moving cube."""
    folder = tmp_path_factory.mktemp("left")
    source = write_text(folder / "moving.usda", cube("m", points=sampled(MOVING)))
    asked = [str(folder), source, processes.WITHOUT, "{}"]
    command = [sys.executable, "-P", "-m", processes.PROGRAM, *asked]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return folder


@pytest.mark.parametrize("how", MEDDLING)
def test_nothing_the_process_says_is_believed(left_behind, monkeypatch, scratch, how) -> None:
    folder = ScratchFolder()

    def report() -> object:
        (folder.path / processes.ARRAYS).write_bytes((left_behind / processes.ARRAYS).read_bytes())
        report = json.loads((left_behind / processes.REPORT).read_text())
        changed = MEDDLING[how](report)
        return changed if how in ("no report", "a list") else report

    told = SimpleNamespace(report=report, folder=folder)
    monkeypatch.setattr(reading, "started", lambda *_: told)
    with pytest.raises(InputError, match=r"moving\.usda: reading it goes astray"):
        read_isolated("moving.usda")
    assert not list(scratch.iterdir())


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    """Run the command line in a folder with a key in it; return exit code and stderr."""
    monkeypatch.chdir(tmp_path)
    Key(bytes(range(32))).save(tmp_path / "k")

    def call(*arguments: object) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["meshmark", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            main()
        return int(stop.value.code or 0), capsys.readouterr().err

    return call


@pytest.fixture
def readings(monkeypatch) -> list[subprocess.Popen]:
    """Collect the processes that are started to read."""
    found = []
    popen = subprocess.Popen

    def start(*args, **kwargs):
        found.append(popen(*args, **kwargs))
        return found[-1]

    there = {**vars(subprocess), "Popen": start}
    monkeypatch.setattr(processes, "subprocess", SimpleNamespace(**there))
    return found


def test_verify_reads_a_file_once_from_before_it_needs_it(run, readings, tmp_path, scratch) -> None:
    source = write_text(tmp_path / "moving.usda", cube("m", points=sampled(MOVING)))
    ahead = run("verify", source, "--key", "k")
    assert len(readings) == 1
    # What readers are told, and what may never be read, is not read ahead.
    assert run("verify", source, "--key", "k", "--clip", "none")[0] == 2
    assert run("verify", source, "--key", "k", "--evidence", "e")[0] == ahead[0]
    assert len(readings) == 2
    assert not list(scratch.glob("*/*"))


def test_embed_reads_a_file_once_with_its_textures(run, readings, tmp_path) -> None:
    source = write_text(tmp_path / "moving.usda", cube("m", points=sampled(MOVING)))
    run("embed", source, "--output", "out.usda", "--key", "k")
    [process] = readings
    assert processes.WITH_TEXTURES in process.args


@pytest.mark.parametrize("words", ["verify", "embed -o out.usda"])
def test_what_was_read_ahead_in_vain_leaves_nothing(
    run, readings, tmp_path, scratch, words
) -> None:
    source = write_text(tmp_path / "moving.usda", cube("m", points=sampled(MOVING)))
    command, *more = words.split()
    code, said = run(command, source, *more, "--key", "missing")
    assert (code, said.count("\n")) == (3, 1)
    [process] = readings
    assert process.returncode is not None
    assert not list(scratch.glob("*/*"))


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere loaders say it in other words")
@pytest.mark.parametrize("command", ["inspect", "check"])
def test_no_memory_even_for_the_library(run, tmp_path, monkeypatch, command) -> None:
    source = write_text(tmp_path / "a.usda", cube("a"))
    monkeypatch.setenv("MESHMARK_READ_MEMORY", "0.01")
    code, said = run(command, source)
    assert code == 3
    assert "needs more than 0.01 GB of memory to read" in said


COMMANDS = {
    "inspect": [],
    "verify": ["--key", "k"],
    "embed": ["--key", "k", "-o", "out.usda"],
    "segment": ["-o", "out.usda"],
    "bench": ["--suite", "tsai2014", "-o", "bench"],
}


@pytest.mark.parametrize("command", [*COMMANDS, "attack"])
def test_a_file_that_crashes_the_library(run, tmp_path, command) -> None:
    if command == "attack":
        code, said = run("attack", "noise", CRASHING, "-o", "out.usdc")
    else:
        code, said = run(command, CRASHING, *COMMANDS[command])
    assert code == 3
    [line] = said.splitlines()
    assert line.startswith(f"error: {CRASHING}: crashes the USD library (signal ")
    assert not list(tmp_path.glob("out*"))


def test_a_source_that_is_trusted_is_read_here(run, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(reading, "started", lambda *_: pytest.fail("read apart"))
    source = write_text(tmp_path / "a.usda", cube("a"))
    assert run("inspect", source, "--trusted")[0] == 1
    with pytest.raises(pytest.fail.Exception):
        read(source, isolated=True)


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks at processes")
@pytest.mark.parametrize("signum", [signal.SIGINT, signal.SIGTERM])
def test_a_command_told_to_end_takes_its_reading_with_it(tmp_path, scratch, signum) -> None:
    source = write_text(tmp_path / "many.usda", nested_references(40))
    command = [sys.executable, "-P", "-m", "meshmark", "inspect", source]
    environment = {**os.environ, "TMPDIR": str(scratch)}
    with subprocess.Popen(
        command, env=environment, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        end = time.monotonic() + 60.0
        while not reading_processes(process.pid) and time.monotonic() < end:
            time.sleep(0.05)
        os.killpg(process.pid, signum)
        _, said = process.communicate(timeout=30)
        assert process.returncode == 128 + signum
        assert said.count("\n") == 1
        assert not reading_processes(process.pid)
    assert not list(scratch.iterdir())


def reading_processes(group: int) -> list[str]:
    """List the living processes of a group that read."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            words = (entry / "cmdline").read_bytes()
            if processes.PROGRAM.encode() in words and os.getpgid(int(entry.name)) == group:
                found.append(entry.name)
        except OSError:
            continue
    return found


@pytest.mark.slow
def test_mutated_crates(tmp_path, hasty) -> None:
    original = bytearray(CRASHING.read_bytes())
    generator = np.random.default_rng(SEED)
    outcomes = set()
    for n in range(40):
        mutated = original.copy()
        for at in generator.integers(len(mutated), size=1 + n % 8):
            mutated[at] = generator.integers(256)
        path = tmp_path / f"{n}.usdc"
        path.write_bytes(mutated)
        try:
            read_isolated(path)
            outcomes.add("read")
        except InputError as error:
            outcomes.add(error.message.partition(" (")[0])
    assert "crashes the USD library" in outcomes
