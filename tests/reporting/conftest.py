"""Reports that several test files open, made by the command line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from command_line import command
from meshmark.commands.attack import write_attacked
from meshmark.keys import Key
from meshmark.mesh.asset import as_asset
from meshmark.testing.informed_schemes import horned
from report_pages import RECIPIENT


@dataclass(frozen=True)
class Made:
    """A folder with a marked copy of horns, and the pages of both commands."""

    folder: Path
    codes: tuple[int, ...]

    @property
    def mark(self) -> Path:
        return self.folder / "mark.html"

    @property
    def copy(self) -> Path:
        return self.folder / "copy.html"


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    folder = tmp_path_factory.mktemp("reports")
    Key(bytes(range(32))).save(folder / "studio.key")
    write_attacked(as_asset(horned()), folder / "horns.usdc")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        mark = ("--key", "studio.key", "--scheme", "relief", "--recipient", RECIPIENT)
        beside = ("--original", "horns.usdc", "-o", "copy.html")
        codes = (
            command(patch, "embed", "horns.usdc", "-o", "m.usdc", *mark, "--report", "mark.html"),
            command(patch, "report", "m.usdc", *mark, *beside),
        )
    return Made(folder, codes)
