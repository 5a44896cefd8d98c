"""What `plugins new` writes is whole, can be installed as it is, and passes its own tests."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import tomllib
import venv
from itertools import product
from pathlib import Path

import pytest

from command_line import command
from folders import REPOSITORY
from meshmark.commands import new_plugin as module
from meshmark.commands.new_plugin import KINDS, LONGEST, new_plugin, rendered
from meshmark.errors import OutputError, UsageError

NAMES = ["a", "ab-" * (LONGEST // 3 - 1) + "abc"]


def test_files_are_whole_and_as_tidy_as_ours(tmp_path) -> None:
    for kind, name in product(KINDS, NAMES):
        folder = new_plugin(name, kind, tmp_path / f"{name}-{kind}")
        files = [path for path in folder.rglob("*") if path.is_file()]
        written = {path.relative_to(folder).as_posix(): path.read_text() for path in files}
        assert written == rendered(name, kind)
        assert not [text for text in written.values() if "$" in text.replace("$ ", "")]
        project = tomllib.loads(written["pyproject.toml"])["project"]
        assert project["entry-points"]["meshmark"] == {name: f"meshmark_{name.replace('-', '_')}"}
        # The author chooses.
        assert "license" not in project
    for check in (["check"], ["format", "--check"]):
        done = run([sys.executable, "-m", "ruff", *check, "--no-cache", "."], tmp_path)
        assert done.returncode == 0, done.stdout


@pytest.mark.parametrize(
    "name", ["", "Upper", "2d", "a_b", "a--b", "-a", "a-", "a.b", "../a", "a\n", "é", "a" * 25]
)
def test_what_is_no_name_is_refused(tmp_path, name) -> None:
    with pytest.raises(UsageError, match="is no name for a plugin"):
        new_plugin(name, "attack", tmp_path / "new")
    assert not list(tmp_path.iterdir())


def test_names_that_are_taken_are_refused(tmp_path) -> None:
    with pytest.raises(UsageError, match="'dijkstra' is offered by meshmark already"):
        new_plugin("dijkstra", "solver", tmp_path / "new")
    # The built-ins are in a package of this name.
    with pytest.raises(UsageError, match="there is a module meshmark_plugins already"):
        new_plugin("plugins", "solver", tmp_path / "new")
    with pytest.raises(UsageError, match="no kind of plugin is called 'geodesic'"):
        new_plugin("mine", "geodesic", tmp_path / "new")
    # Another kind may have the name.
    assert new_plugin("dijkstra", "attack", tmp_path / "new").is_dir()


def test_what_is_there_stays_and_nothing_is_left_half_written(tmp_path, monkeypatch) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    for name in ("there", "link"):
        with pytest.raises(OutputError, match="is there already"):
            new_plugin("mine", "reader", tmp_path / name)
    with pytest.raises(OutputError, match="cannot be written"):
        new_plugin("mine", "reader", tmp_path / "no" / "such" / "folder")
    before = sorted(tmp_path.rglob("*"))
    real, written = module._filled, []

    def full(template: str, words: dict[str, str]) -> str:
        written.append(template)
        if len(written) == 4:
            raise OSError(28, "No space left on device")
        return real(template, words)

    monkeypatch.setattr(module, "_filled", full)
    with pytest.raises(OutputError, match="No space left"):
        new_plugin("mine", "reader", tmp_path / "new")
    assert sorted(tmp_path.rglob("*")) == before


def test_the_command_writes_beside_where_it_is_called(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert command(monkeypatch, "plugins", "new", "lean", "--kind", "attack") == 0
    assert "meshmark-lean" in capsys.readouterr().err
    assert (tmp_path / "meshmark-lean" / "src" / "meshmark_lean" / "attack.py").is_file()
    assert command(monkeypatch, "plugins", "new", "lean", "--kind", "attack") == 3
    assert command(monkeypatch, "plugins", "new", "Lean", "--kind", "attack") == 2


@pytest.fixture(scope="module")
def python(tmp_path_factory) -> Path:
    """A new environment that sees this one's packages behind its own; of nobody is asked more."""
    folder = tmp_path_factory.mktemp("venv")
    venv.create(folder, with_pip=False, symlinks=os.name == "posix")
    base = {"base": str(folder), "platbase": str(folder)}
    site = Path(sysconfig.get_path("purelib", "venv", vars=base))
    behind = [REPOSITORY, REPOSITORY / "plugins", sysconfig.get_path("purelib")]
    (site / "behind.pth").write_text("\n".join(map(str, behind)))
    return Path(sysconfig.get_path("scripts", "venv", vars=base)) / "python"


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_is_built_and_installed_and_passes_its_tests(tmp_path, python, kind) -> None:
    name = f"strange-{kind}"
    folder = new_plugin(name, kind, tmp_path / "source")
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    alone = ["--no-deps", "--no-index"]
    steps = [
        [*pip, "wheel", *alone, "--no-build-isolation", "--wheel-dir", ".", folder],
        [
            *pip,
            "--python",
            python,
            "install",
            *alone,
            f"meshmark_strange_{kind}-0.1.0-py3-none-any.whl",
        ],
    ]
    for step in steps:
        done = run(step, tmp_path)
        assert done.returncode == 0, done.stdout
    # Without the sources: it is the installed one that is tested.
    options = ["-q", "-p", "no:cacheprovider", "-p", "no:dash", "-o", "pythonpath="]
    tested = run([python, "-m", "pytest", *options, folder / "tests"], tmp_path)
    assert tested.returncode == 0, tested.stdout
    assert "passed" in tested.stdout
    checked = run([python, "-m", "meshmark", "plugins", "check", name], tmp_path)
    assert checked.returncode == 0, checked.stdout
    assert f"{KINDS[kind].registered or kind} {name} 1 of meshmark-{name}: works" in checked.stdout
    typed = run([sys.executable, "-m", "mypy", "--cache-dir", tmp_path / "cache"], folder)
    assert typed.returncode == 0, typed.stdout


def run(words: list[object], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a program in a folder, with all it says in `stdout`."""
    return subprocess.run(
        list(map(str, words)),
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
        timeout=300,
    )
