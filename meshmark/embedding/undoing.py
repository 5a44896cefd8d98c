"""Puts outputs back as they were, where what was to be done with them fails in the end."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from meshmark.embedding.manifest import manifest_path
from meshmark.errors import OutputError
from meshmark.files.atomic import beside
from meshmark.files.places import assets_folder, data_files


@dataclass
class Undoing:
    """What stood in the place of outputs, until it is settled that others stand there."""

    outputs: Sequence[Path]
    _kept: dict[Path, Path] = field(default_factory=dict)
    _settled: bool = False

    def settle(self, finish: Callable[[], object]) -> None:
        """Do what is left to do; from then on the new outputs stay, whatever is raised.

        No signal cuts this short: see `meshmark.cli.stopping`.
        """
        finish()
        self._settled = True

    def keep(self, folders: ExitStack) -> None:
        """Keep what stands there now: by links, which need no room on the disk."""
        for output in self.outputs:
            folder = folders.enter_context(beside(output)).parent
            for number, place in enumerate(_standing(output)):
                self._kept[place] = folder / f"{number}"
                _link(place, self._kept[place])

    def put_back(self) -> None:
        """Put it back, and remove what was not there.

        Raises
        ------
        OutputError
            If that cannot be done.
        """
        if self._settled:
            return
        place: Path | None = None
        try:
            for place in (there for output in self.outputs for there in _standing(output)):
                if place not in self._kept:
                    _remove(place)
            for place, kept in self._kept.items():
                _return(kept, place)
        except OSError as error:
            raise OutputError(
                f"cannot be put back as it was: {error.strerror}", source=place
            ) from None


@contextmanager
def as_they_were(outputs: Sequence[Path]) -> Iterator[Undoing]:
    """Put outputs, their manifests and what else is beside them back if the block fails.

    All is put back unless the block has settled that it stays.

    Raises
    ------
    OutputError
        If what stands there cannot be kept or put back.
    """
    undoing = Undoing(outputs)
    with ExitStack() as folders:
        undoing.keep(folders)
        try:
            yield undoing
        except BaseException:
            undoing.put_back()
            raise


def _standing(output: Path) -> list[Path]:
    """List what there is of an output."""
    places = [output, manifest_path(output), assets_folder(output), *data_files(output)]
    return [place for place in places if os.path.lexists(place)]


def _link(place: Path, kept: Path) -> None:
    if place.is_dir() and not place.is_symlink():
        shutil.copytree(place, kept, symlinks=True, copy_function=_link_file)
    else:
        _link_file(place, kept)


def _link_file(place: str | Path, kept: str | Path) -> None:
    try:
        os.link(place, kept, follow_symlinks=False)
    except (OSError, NotImplementedError):
        # Not every disk has links.
        shutil.copy2(place, kept, follow_symlinks=False)


def _return(kept: Path, place: Path) -> None:
    if kept.is_dir() and not kept.is_symlink():
        with suppress(FileNotFoundError):
            shutil.rmtree(place)
        kept.rename(place)
    else:
        kept.replace(place)


def _remove(place: Path) -> None:
    if place.is_dir() and not place.is_symlink():
        shutil.rmtree(place)
    else:
        place.unlink()
