"""Arrows point one way, and nothing heavy is imported before it is needed."""

from __future__ import annotations

import ast
import importlib
import re
import subprocess
import sys
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import meshmark
from folders import REPOSITORY

CORE = REPOSITORY / "meshmark"
PLUGINS = REPOSITORY / "plugins" / "meshmark_plugins"
HEAVY = ("pxr", "open3d", "numba", "potpourri3d", "pygeodesic", "fast_simplification", "pytest")
# Half a second together, which --help has no use for.
NUMERIC = ("numpy", "scipy", "cryptography")
# This is where open3d is imported, by name; nobody else does it.
DOOR = CORE / "mesh" / "open3d_import.py"


def modules_of(folder: Path) -> list[Path]:
    """List a package's modules; an empty list would prove nothing."""
    found = sorted(folder.rglob("*.py"))
    assert found, f"no modules in {folder}"
    return found


def imports_of(path: Path, package_root: Path) -> Iterator[str]:
    """Name every module a file imports, wherever in the file, as an absolute name."""
    package = path.relative_to(package_root).parts[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            module = ".".join(part for part in (base, node.module or "") if part)
            yield module
            yield from (f"{module}.{alias.name}" for alias in node.names)


def within(name: str, package: str) -> bool:
    return name == package or name.startswith(f"{package}.")


def loaded_after(statement: str) -> set[str]:
    """Run a statement in a new interpreter and name the top-level modules it loaded."""
    # A command leaves through SystemExit; what it loaded is told all the same.
    program = (
        "import sys\n"
        f"try:\n    {statement}\n"
        "except SystemExit as leaving:\n    assert not leaving.code, leaving.code\n"
        "print('\\nloaded:', *sorted({name.partition('.')[0] for name in sys.modules}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 0, done.stderr
    return set(done.stdout.rpartition("loaded:")[2].split())


@pytest.mark.parametrize(
    "statement",
    [
        "import meshmark",
        "import meshmark.cli; sys.argv = ['meshmark', '--help']; meshmark.cli.main()",
    ],
    ids=["import", "help"],
)
def test_nothing_heavy_is_imported_early(statement: str) -> None:
    loaded = loaded_after(statement)
    assert "meshmark" in loaded
    assert loaded.isdisjoint((*HEAVY, *NUMERIC))
    assert "meshmark_plugins" not in loaded


def test_every_public_name_is_found_where_it_is_said_to_be() -> None:
    tree = ast.parse((CORE / "__init__.pyi").read_text("utf-8"))
    said = {
        alias.name: f"meshmark.{node.module}"
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert sorted(said) == sorted(meshmark.__all__)
    assert set(meshmark.__all__) <= set(dir(meshmark))
    for name, module in said.items():
        assert getattr(meshmark, name) is getattr(importlib.import_module(module), name)
    with pytest.raises(AttributeError, match="attribute unheard_of"):
        meshmark.unheard_of  # noqa: B018


def floors() -> dict[str, int]:
    """Read which room is on which floor from the picture in docs/architecture.md."""
    page = (REPOSITORY / "docs" / "architecture.md").read_text("utf-8")
    picture = page.partition("floor  room\n")[2].partition("```")[0]
    return {room: int(floor) for floor, room in re.findall(r"^ *(\d+) +(\w+)", picture, re.M)}


def room_of(module: str) -> str:
    return module.split(".")[1]


def module_of(path: Path, package_root: Path) -> str:
    return ".".join(path.relative_to(package_root).with_suffix("").parts).removesuffix(".__init__")


def test_the_picture_shows_every_room_and_no_other() -> None:
    rooms = {path.relative_to(CORE).parts[0].removesuffix(".py") for path in modules_of(CORE)}
    assert rooms - {"__init__", "__main__"} == set(floors())


def test_every_arrow_runs_down() -> None:
    floor = floors()
    arrows = {
        (room_of(module_of(path, REPOSITORY)), room_of(name), name)
        for path in modules_of(CORE)
        if path.parent != CORE or path.stem not in ("__init__", "__main__")
        for name in imports_of(path, REPOSITORY)
        if within(name, "meshmark") and name.count(".") >= 1 and room_of(name) in floor
    }
    assert len(arrows) > 100
    assert not [
        f"{above} imports {name}"
        for above, below, name in sorted(arrows)
        if above != below and floor[above] >= floor[below]
    ]


def test_no_modules_import_each_other_in_a_circle() -> None:
    modules = {
        module_of(path, root): set(imports_of(path, root))
        for root, package in ((REPOSITORY, CORE), (PLUGINS.parent, PLUGINS))
        for path in modules_of(package)
        if path != CORE / "__init__.py"
    }
    assert len(modules) > 200
    known = {name: used & (modules.keys() - {name}) for name, used in modules.items()}
    list(TopologicalSorter(known).static_order())


def test_core_never_imports_a_plugin() -> None:
    assert not [
        f"{path.relative_to(CORE)} imports {name}"
        for path in modules_of(CORE)
        for name in imports_of(path, REPOSITORY)
        if within(name, "meshmark_plugins")
    ]


def test_plugins_know_neither_each_other_nor_the_command_line() -> None:
    strangers = []
    for path in modules_of(PLUGINS):
        place = path.relative_to(PLUGINS)
        own = f"meshmark_plugins.{place.parts[0].removesuffix('.py')}"
        strangers += [
            f"{place} imports {name}"
            for name in imports_of(path, PLUGINS.parent)
            if within(name, "meshmark.cli")
            or (within(name, "meshmark_plugins") and not within(name, own))
        ]
    assert not strangers


def test_open3d_is_imported_through_its_door() -> None:
    assert not [
        str(path.relative_to(REPOSITORY))
        for path in modules_of(CORE) + modules_of(PLUGINS)
        if path != DOOR
        for name in imports_of(path, path.parent)
        if within(name, "open3d")
    ]


def test_compiled_loops_are_let_in_by_kernels() -> None:
    """Whoever imported them, or numba, would need numba, and read settings wherever he works."""
    modules = modules_of(CORE) + modules_of(PLUGINS)
    loops = {path.stem for path in modules if path.stem.endswith("loops")}
    assert loops
    assert not [
        f"{path.relative_to(REPOSITORY)} imports {name}"
        for path in modules
        for name in imports_of(path, REPOSITORY)
        # Loops call loops.
        if within(name, "numba") or (path.stem not in loops and loops & set(name.split(".")))
    ]
