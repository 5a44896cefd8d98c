"""Nothing in the working directory is imported, whatever it is called, by any command."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from importlib.metadata import packages_distributions
from itertools import product
from pathlib import Path

import pytest

from folders import REPOSITORY
from meshmark.commands.attack import write_attacked
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.testing.meshes import icosphere

TRAP = "from os import environ\nopen(environ['SPRUNG'], 'a').write(__name__ + '\\n')\n"
DISTRIBUTION = "Metadata-Version: 2.1\nName: stranger\nVersion: 1.0\n"
WAYS = {
    "script": [str(Path(sys.executable).parent / "meshmark")],
    "module": [sys.executable, "-m", "meshmark"],
    "safe module": [sys.executable, "-P", "-m", "meshmark"],
}
VERIFY = ["verify", "ball.usdc", "--key", "k", "--frames", ":", "--scheme", "cho2007"]
EMBED = ["embed", "ball.usdc", "-o", "marked.usda", "--key", "k", "--scheme", "cho2007"]
COMMANDS = [
    ["--version"],
    ["plugins", "list"],
    ["plugins", "check", "dijkstra"],
    ["keygen", "new.key"],
    ["inspect", "ball.usdc"],
    [*VERIFY, "again.usdc"],
    [*EMBED, "--deliver"],
    ["attack", "noise", "ball.usdc", "-o", "noisy.usdc"],
    ["segment", "ball.usdc", "-o", "parts.usda"],
    ["bench", "ball.usdc", "--suite", "tsai2014", "--scheme", "cho2007", "-o", "bench"],
]
# A demonstration takes as long as all the others.
CASES = [*product(("script", "module"), COMMANDS), ("script", ["demo"])]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Return a folder with a moving ball, a key, and a trap under every name that is imported."""
    folder = tmp_path_factory.mktemp("leak")
    V, F = icosphere(3)
    ball = MeshAnimation.from_arrays(
        [V * (1.0 + 0.1 * t) * (1.0, 1.2, 0.8) for t in range(4)], F, prim="/Ball"
    )
    for name in ("ball.usdc", "again.usdc"):
        write_attacked(Asset("ball", (ball,), "memory"), folder / name)
    Key(bytes(range(32))).save(folder / "k")
    names = {*sys.stdlib_module_names, *packages_distributions(), "sitecustomize", "stranger"}
    for name in names - {"meshmark"}:
        if name.isidentifier():
            (folder / f"{name}.py").write_text(TRAP)
    for suffix, metadata in (("dist-info", "METADATA"), ("egg-info", "PKG-INFO")):
        described = folder / f"stranger-1.0.{suffix}"
        described.mkdir()
        (described / metadata).write_text(DISTRIBUTION)
        (described / "entry_points.txt").write_text("[meshmark]\nstranger = stranger\n")
    (folder / "matplotlibrc").write_text("font.size: 99\nbackend: module://stranger\n")
    (folder / "plugInfo.json").write_text(
        '{"Plugins": [{"Type": "python", "Name": "stranger", "Root": ".", "Info": {"Types": '
        '{"stranger.Format": {"bases": ["SdfFileFormat"], "extensions": ["usdc"]}}}}]}'
    )
    return folder


@pytest.fixture(scope="module")
def folders(folder, tmp_path_factory) -> dict[str, Path]:
    """Return a folder for each way to run a command.

    What Python itself imports for `-m`, before there is anything of ours, is for Python to promise.
    """
    bare = tmp_path_factory.mktemp("bare")
    (bare / "probe.py").write_text("import sys\nprint(*sys.modules)\n")
    _, before, _ = sprung(bare, [sys.executable, "-m", "probe"])
    spared = shutil.copytree(folder, bare / "leak")
    for name in before.split():
        (spared / f"{name}.py").unlink(missing_ok=True)
    assert (spared / "typing.py").exists()
    assert (spared / "pickle.py").exists()
    return {"script": folder, "safe module": folder, "module": spared}


def sprung(folder: Path, command: list[str], **environment: str) -> tuple[int, str, str]:
    """Run a command in the folder; return its exit code, what it said, and which traps sprang."""
    note = folder / "sprung"
    note.unlink(missing_ok=True)
    done = subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, "MESHMARK_JOBS": "2", "SPRUNG": str(note), **environment},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    return done.returncode, done.stdout + done.stderr, note.read_text() if note.exists() else ""


def test_the_traps_spring(folder) -> None:
    """Otherwise the other tests would prove nothing."""
    code, _, trapped = sprung(folder, [sys.executable, "-c", "import pickle, numpy, stranger"])
    assert (code, trapped.split()) == (0, ["pickle", "numpy", "stranger"])


@pytest.mark.parametrize(
    "way",
    [
        "script",
        *(pytest.param(way, marks=pytest.mark.slow) for way in WAYS if way != "script"),
    ],
)
def test_nothing_beside_a_leaked_copy_is_imported(folders, way) -> None:
    code, said, trapped = sprung(folders[way], [*WAYS[way], *VERIFY])
    assert trapped == ""
    assert code == 1, said


@pytest.mark.slow
@pytest.mark.parametrize(("way", "command"), CASES, ids=str)
def test_no_command_imports_what_stands_beside_its_files(folders, way, command) -> None:
    (folders[way] / "new.key").unlink(missing_ok=True)
    code, said, trapped = sprung(folders[way], [*WAYS[way], *command])
    assert trapped == ""
    assert code in (0, 1), said
    assert "stranger" not in said


def test_plots_are_drawn_as_the_installation_says(folder) -> None:
    program = (
        "from pathlib import Path; from meshmark.benchmarking.plots import draw_plots; "
        "draw_plots({'rows': []}, Path()); import matplotlib; "
        "print(matplotlib.rcParams['font.size'])"
    )
    assert sprung(folder, [sys.executable, "-P", "-c", program])[1:] == ("10.0\n", "")


PUBLISH = """
import sys
sys.path[:0] = {paths!r}
from meshmark.workers.ordered_map import ordered_map
if __name__ == "__main__":
    assert list(ordered_map(abs, [-1, -2, -3, -4], jobs=2)) == [1, 2, 3, 4]
    import os
    assert "PYTHONSAFEPATH" not in os.environ
"""


@pytest.fixture
def publish(tmp_path) -> str:
    program = tmp_path / "publish.py"
    paths = [str(REPOSITORY), str(REPOSITORY / "plugins")]
    program.write_text(PUBLISH.format(paths=paths))
    return str(program)


def test_workers_of_an_application_import_nothing_from_there(folder, publish) -> None:
    code, said, trapped = sprung(folder, [sys.executable, publish])
    assert (code, trapped) == (0, ""), said


def test_workers_that_would_import_from_there_are_not_started(folder, publish) -> None:
    code, said, trapped = sprung(folder, [sys.executable, "-E", publish])
    assert (code, trapped) == (1, "")
    assert "add -P" in said
    code, said, trapped = sprung(folder, [sys.executable, "-E", "-P", publish])
    assert (code, trapped) == (0, ""), said
