"""Files are read only where they are files, and written whole or not at all."""

from __future__ import annotations

import errno
import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from meshmark.cli import main
from meshmark.errors import InputError, OutputError
from meshmark.files.atomic import written_beside
from meshmark.files.reading import opened, read_small
from meshmark.keys import Key
from usd_stages import cube, write_text

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pipes, devices and permissions")


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    """Run the command line in a folder with a stage and a key; return exit code and stderr."""
    monkeypatch.chdir(tmp_path)
    Key(bytes(range(32))).save(tmp_path / "k")
    write_text(tmp_path / "a.usda", cube("a"))

    def call(*arguments: str) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["meshmark", *arguments])
        with pytest.raises(SystemExit) as stop:
            main()
        return int(stop.value.code or 0), capsys.readouterr().err

    return call


def strange(folder: Path, kind: str, suffix: str = "") -> str:
    """Make something that can be opened, and is no file; return its path."""
    path = folder / f"strange{suffix}"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to("/dev/zero")
    return str(path)


USES = {
    "key": ("verify", "a.usda", "--key", "{}"),
    "names": ("verify", "a.usda", "--key", "k", "--recipient", "@{}"),
    "evidence": ("verify", "a.usda", "--key", "k", "--evidence", "{}"),
}


@pytest.mark.parametrize("kind", ["pipe", "device", "folder"])
@pytest.mark.parametrize("use", USES)
def test_what_is_no_file_is_not_read(run, tmp_path, kind, use) -> None:
    path = strange(tmp_path, kind)
    code, said = run(*(word.format(path) for word in USES[use]))
    assert code == 3
    assert said.splitlines()[-1].startswith(f"error: {path}: is not a file")


@pytest.mark.parametrize("trusted", [(), ("--trusted",)])
@pytest.mark.parametrize("suffix", [".usda", ".usdz", ".obj", ""])
@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_what_is_no_file_is_no_source(run, tmp_path, kind, suffix, trusted) -> None:
    path = strange(tmp_path, kind, suffix)
    code, said = run("inspect", path, *trusted)
    assert (code, said) == (3, f"error: {path}: is neither a file nor a folder\n")


def test_a_pipe_among_frames_is_none_of_them(run, tmp_path) -> None:
    (tmp_path / "frames").mkdir()
    for t in (1, 2):
        text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
        (tmp_path / "frames" / f"{t}.obj").write_text(text)
    os.mkfifo(tmp_path / "frames" / "3.obj")
    assert run("inspect", "frames")[0] == 1
    code, said = run("inspect", "frames/*.obj")
    assert code in (1, 3), said


def test_small_files_are_small(tmp_path) -> None:
    path = tmp_path / "k"
    path.write_bytes(b"12345")
    assert read_small(path, 5) == b"12345"
    with pytest.raises(InputError, match="too large: more than 4 bytes"):
        read_small(path, 4)
    with pytest.raises(InputError, match="cannot be read: No such file"), opened(tmp_path / "x"):
        pass
    path.write_bytes(b" " * (1 << 20))
    with pytest.raises(InputError, match="too large"):
        Key.load(path)


@pytest.fixture(params=[0o077, 0o002, 0o022])
def umask(request):
    before = os.umask(request.param)
    yield request.param
    os.umask(before)


def test_written_files_respect_the_umask(umask, tmp_path) -> None:
    path = tmp_path / "manifest"
    with written_beside(path) as file:
        file.write(b"{}")
    assert stat.S_IMODE(path.stat().st_mode) == 0o666 & ~umask
    key = tmp_path / "k"
    Key.generate().save(key)
    assert stat.S_IMODE(key.stat().st_mode) == 0o600
    assert sorted(tmp_path.iterdir()) == [key, path]


@pytest.mark.slow
def test_outputs_evidence_and_manifests_respect_the_umask(tmp_path, creature) -> None:
    from meshmark.commands.attack import write_attacked
    from meshmark.mesh.asset import Asset

    asset = Asset("creature", (creature.select([0]),), "memory")
    write_attacked(asset, tmp_path / "a.usdc")
    Key(bytes(range(32))).save(tmp_path / "k")
    base = f"umask 027; {sys.executable} -P -m meshmark"
    scheme = "--key k --scheme cho2007"
    for command in (
        f"{base} embed a.usdc -o out.usda {scheme}",
        f"{base} embed a.usdc -o out.usdc --deliver {scheme}",
        f"{base} attack noise a.usdc -o noisy",
        f"{base} verify out.usda {scheme} --evidence out.evidence",
    ):
        environment = {**os.environ, "MESHMARK_EVIDENCE_SECRET": str(tmp_path / "s")}
        subprocess.run(["sh", "-c", command], cwd=tmp_path, env=environment, check=True)
    written = [*tmp_path.glob("out*"), *tmp_path.glob("noisy/*")]
    assert len(written) == 6
    assert {stat.S_IMODE(path.stat().st_mode) for path in written} == {0o640}
    assert stat.S_IMODE((tmp_path / "noisy").stat().st_mode) == 0o750


def fail_with(number: int):
    def fail(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number))

    return fail


def test_a_full_disk_leaves_no_empty_key(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(os, "fsync", fail_with(errno.ENOSPC))
    with pytest.raises(OutputError, match="cannot write the key file: No space left"):
        Key.generate().save(tmp_path / "k")
    assert not list(tmp_path.iterdir())
    monkeypatch.setattr(os, "link", fail_with(errno.EPERM))
    with pytest.raises(OutputError, match="No space left"):
        Key.generate().save(tmp_path / "k")
    assert not list(tmp_path.iterdir())


def test_a_disk_without_links_can_hold_a_key(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(os, "link", fail_with(errno.EPERM))
    key, path = Key.generate(), tmp_path / "k"
    key.save(path)
    assert Key.load(path) == key
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    with pytest.raises(OutputError, match="never overwritten"):
        Key.generate().save(path)
    assert Key.load(path) == key
    assert list(tmp_path.iterdir()) == [path]
