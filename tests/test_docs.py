"""What README and the pages under docs/ claim is executed, in the order of the page.

A fenced block says how in its info string:

- ```` ```console ````: lines that begin with `$ ` are commands. `# exit N` at the end of one tells
  its exit code, 0 where there is none. Other lines are output, which the command must print, on
  stdout or stderr; `...` stands for anything.
- ```` ```python ````: executed; all blocks of a page share their names.
- `needs-data` after either: skipped where the reference assets are absent; commands find their
  folder in $MESHMARK_DATA.
- `no-run` after either: for the reader only.
- `<!-- file: PATH -->` above a block of any kind: the block is that file of the repository.

The pages take for granted that `meshmark demo` was run; a smaller creature stands in for its own.
Every key file a page makes is then exchanged for a fixed one, so that each run is the same run.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import typer

import meshmark
from folders import REPOSITORY
from meshmark.cli.app import app
from meshmark.demo import creature

PAGES = [REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").rglob("*.md"))]
BLOCK = re.compile(
    r"(?:^<!-- file: (?P<file>\S+) -->\n+)?^```(?P<info>[^\n]*)\n(?P<body>.*?)^```$", re.M | re.S
)
KEY_FILE = Path("studio.key")
EXIT = re.compile(r"\s+# exit (\d+)$")
LINK = re.compile(r"\]\((?!https?:|#|mailto:)([^)#\s]+)[^)]*\)")


@dataclass(frozen=True)
class Block:
    """A fenced block of a page."""

    page: Path
    line: int
    language: str
    flags: tuple[str, ...]
    file: str | None
    body: str

    @property
    def where(self) -> str:
        return f"{self.page.relative_to(REPOSITORY)}:{self.line}"


def blocks_of(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    found = []
    for match in BLOCK.finditer(text):
        language, *flags = match["info"].split() or [""]
        line = text.count("\n", 0, match.start("info")) + 1
        found.append(Block(page, line, language, tuple(flags), match["file"], match["body"]))
    return found


def steps_of(block: Block) -> Iterator[tuple[str, int, str]]:
    """Split a console block into commands, exit codes and expected outputs."""
    for step in re.split(r"^\$ ", block.body, flags=re.M)[1:]:
        command, _, output = step.replace("\\\n", " ").partition("\n")
        told = EXIT.search(command)
        yield EXIT.sub("", command), int(told[1]) if told else 0, output.strip()


def appears(expected: str, output: str) -> bool:
    """Tell whether `output` holds `expected`, whatever the blanks; `...` is anything."""
    pieces = [r"\s+".join(map(re.escape, piece.split())) for piece in expected.split("...")]
    return re.search(".*?".join(pieces), output, flags=re.S) is not None


def run_console(block: Block, environment: dict[str, str]) -> None:
    for command, code, expected in steps_of(block):
        keyless = not KEY_FILE.exists()
        done = subprocess.run(
            ["bash", "-c", command],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
            timeout=300,
        )
        told = f"{block.where}: $ {command}\n{done.stdout}"
        assert done.returncode == code, told
        assert appears(expected, done.stdout), f"{told}\nexpected:\n{expected}"
        fix_key(made=keyless and KEY_FILE.exists())


def run_python(block: Block, names: dict[str, Any]) -> None:
    source = "\n" * block.line + block.body
    exec(compile(source, str(block.page), "exec"), names)


def fix_key(made: bool) -> None:
    """Exchange a key file that was just made for the key of bytes 0, 1, .. 31."""
    if made:
        KEY_FILE.unlink()
        meshmark.Key(bytes(range(32))).save(KEY_FILE)


@pytest.fixture(scope="session")
def demo_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `meshmark demo` leaves, in small."""
    folder = tmp_path_factory.mktemp("demo")
    asset = meshmark.Asset("creature", (creature(frames=4),), "memory")
    meshmark.write(asset, asset, folder / "creature.usdc")
    return folder


@pytest.fixture
def environment(third_party_site: Path) -> dict[str, str]:
    """Environment in which `meshmark` and the plugin of docs/plugins.md are installed."""
    python_path = os.pathsep.join([str(third_party_site), os.environ.get("PYTHONPATH", "")])
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    return {
        **os.environ,
        "PATH": path,
        "PYTHONPATH": python_path,
        # Starting workers takes longer than four small frames.
        "MESHMARK_JOBS": "1",
    }


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(REPOSITORY)))
def test_examples_do_what_the_page_says(
    page: Path,
    environment: dict[str, str],
    demo_folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(demo_folder, "meshmark-demo")
    names: dict[str, Any] = {"__name__": "__docs__"}
    for block in blocks_of(page):
        if block.file is not None:
            expected = (REPOSITORY / block.file).read_text(encoding="utf-8")
            assert block.body == expected, f"{block.where} is not {block.file}"
            continue
        if "no-run" in block.flags:
            continue
        if "needs-data" in block.flags:
            environment["MESHMARK_DATA"] = str(request.getfixturevalue("data_folder"))
        if block.language == "console":
            run_console(block, environment)
        elif block.language == "python":
            run_python(block, names)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(REPOSITORY)))
def test_links_lead_somewhere(page: Path) -> None:
    prose = BLOCK.sub("", page.read_text(encoding="utf-8"))
    lost = [link for link in LINK.findall(prose) if not (page.parent / link).exists()]
    assert not lost


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(REPOSITORY)))
def test_blocks_say_what_they_are(page: Path) -> None:
    known = {"needs-data", "no-run"}
    for block in blocks_of(page):
        assert block.language, f"{block.where} has no language"
        assert set(block.flags) <= known, block.where


def commands_of(command: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Name a command and all below it."""
    yield name, command
    for word, inner in getattr(command, "commands", {}).items():
        yield from commands_of(inner, f"{name} {word}")


def test_every_command_and_flag_is_described_and_no_other() -> None:
    page = (REPOSITORY / "docs" / "cli.md").read_text(encoding="utf-8")
    sections = re.split(r"^## ", page, flags=re.M)
    described: set[str] = set()
    for name, command in commands_of(typer.main.get_command(app), "meshmark"):
        if getattr(command, "commands", None):
            continue
        flags = {flag for parameter in command.params for flag in parameter.opts if flag[0] == "-"}
        section = "\n".join(text for text in sections if name in text.partition("\n")[0])
        assert section, f"{name} is not on the page"
        missing = [flag for flag in flags if not re.search(rf"(?<![\w-]){flag}(?![\w-])", section)]
        assert not missing, f"{name}: {missing}"
        described |= flags
    known = described | {"--help", "--version"}
    assert set(re.findall(r"(?<![\w-])--[a-z][a-z0-9]*(?:-[a-z]+)*", page)) <= known


def test_every_environment_variable_is_described_and_no_other() -> None:
    name = re.compile(r"MESHMARK_[A-Z]+(?:_[A-Z]+)*")
    code = [*(REPOSITORY / "meshmark").rglob("*.py"), *(REPOSITORY / "tests").glob("*.py")]
    read = {found for path in code for found in name.findall(path.read_text(encoding="utf-8"))}
    page = (REPOSITORY / "docs" / "environment.md").read_text(encoding="utf-8")
    assert "MESHMARK_JOBS" in read
    assert set(name.findall(page)) == read


def test_rooms_of_the_house_exist() -> None:
    page = (REPOSITORY / "docs" / "architecture.md").read_text(encoding="utf-8")
    rooms = re.findall(r"`((?:meshmark|plugins|schemas|benchmarks|tests)/[\w./]*)`", page)
    assert len(rooms) > 20
    assert not [room for room in rooms if not (REPOSITORY / room).exists()]


def test_stops_of_the_journeys_are_functions_of_their_files() -> None:
    page = (REPOSITORY / "docs" / "architecture.md").read_text(encoding="utf-8")
    stops = re.findall(r"^\| \d+\. .*? \| `(\w+)` \| `([\w/.]+)` \|$", page, re.M)
    assert len(stops) > 20
    assert not [
        f"{file}: {name}"
        for name, file in stops
        if not re.search(rf"^(def|class) {name}\b", (REPOSITORY / file).read_text("utf-8"), re.M)
    ]


def test_expected_output_is_really_compared() -> None:
    assert appears("a ... c", "x a  b\nc y")
    assert not appears("a ... d", "x a  b\nc y")
    block = Block(REPOSITORY / "README.md", 1, "console", (), None, "$ echo one\ntwo\n")
    with pytest.raises(AssertionError, match="expected"):
        run_console(block, dict(os.environ))


def test_exit_codes_are_really_compared() -> None:
    block = Block(REPOSITORY / "README.md", 1, "console", (), None, "$ false    # exit 1\n")
    run_console(block, dict(os.environ))
    wrong = Block(REPOSITORY / "README.md", 1, "console", (), None, "$ exit 3    # exit 1\n")
    with pytest.raises(AssertionError):
        run_console(wrong, dict(os.environ))
