"""Files out of packages (.usdz), copied into the folder beside a deliverable.

Names inside a package are a stranger's: they are refused unless they mean the same file below
the folder on every system.
"""

from __future__ import annotations

import os
import re
import shutil
import stat
import unicodedata
import zipfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from pxr import Ar

from meshmark.errors import OutputError

PACKAGE_SUFFIX = ".usdz"
UDIM = "<UDIM>"
MAX_NAME_BYTES = 255
MAX_PATH_BYTES = 1024
_FORBIDDEN = re.compile(r'[\x00-\x1f\x7f\\:<>"|?*]')
_DEVICE = re.compile(r"(con|prn|aux|nul|conin\$|conout\$|com[0-9¹²³]|lpt[0-9¹²³])\s*(\..*)?", re.I)


def safe_parts(name: str, package: str) -> tuple[str, ...]:
    """Split the name of a file in a package into folders and file.

    Raises
    ------
    OutputError
        If it could lead out of a folder, or means something else on some system: absolute or
        climbing names, drives, streams, devices, backslashes, and names too long.
    """
    parts = tuple(name.split("/"))
    if len(os.fsencode(name)) > MAX_PATH_BYTES or not all(map(_is_safe, parts)):
        raise OutputError(f"holds a file of a forbidden name: {name[:200]!r}", source=package)
    return parts


def _is_safe(part: str) -> bool:
    return (
        # Windows drops dots and blanks at the end, and calls the parent folder by what is left.
        part == part.rstrip(". ")
        and part != ""
        and len(os.fsencode(part)) <= MAX_NAME_BYTES
        and not _FORBIDDEN.search(part)
        and not _DEVICE.fullmatch(part)
    )


@dataclass
class Unpacking:
    """Copies files out of packages into one folder; each package gets a numbered one in it.

    Parameters
    ----------
    folder : Path
        Where to; made when the first file is copied.
    """

    folder: Path
    _numbers: dict[str, int] = field(default_factory=dict, init=False)
    _copied: dict[tuple[str, ...], str] = field(default_factory=dict, init=False)
    _bytes: dict[str, int] = field(default_factory=dict, init=False)

    def copy(self, path: str) -> str:
        """Copy the file, or the tiles, that a path into a package names.

        Returns
        -------
        str
            Where to, relative to the folder.

        Raises
        ------
        OutputError
            If there is no such file, its name is forbidden, or it cannot be copied.
        """
        package, name = Ar.SplitPackageRelativePathInner(path)
        number = self._numbers.setdefault(package, 1 + len(self._numbers))
        try:
            with _opened(package) as archive:
                for member in _members(archive, name):
                    self._copy(
                        archive, member, (str(number), *safe_parts(member, package)), package
                    )
        except (OSError, KeyError, ValueError, zipfile.BadZipFile, NotImplementedError) as error:
            raise OutputError(f"{name!r} cannot be copied: {error}", source=package) from None
        return f"{number}/{name}"

    def _copy(
        self, archive: zipfile.ZipFile, member: str, parts: tuple[str, ...], package: str
    ) -> None:
        info = archive.getinfo(member)
        alike = tuple(unicodedata.normalize("NFC", part).casefold() for part in parts)
        known = self._copied.setdefault(alike, member)
        if known != member:
            raise OutputError(f"holds {known!r} and {member!r}: one name", source=package)
        place = self.folder.joinpath(*parts)
        if place.exists():
            return
        _require_plain(info, package)
        self._require_room(package, info.file_size)
        place.parent.mkdir(parents=True, exist_ok=True)
        with archive.open(info) as source, place.open("xb") as target:
            shutil.copyfileobj(source, target)

    def _require_room(self, package: str, size: int) -> None:
        # Files are stored as they are: all together they cannot be larger than their package,
        # unless several names share the same bytes.
        outer = Ar.SplitPackageRelativePathOuter(package)[0] or package
        self._bytes[outer] = self._bytes.get(outer, 0) + size
        if self._bytes[outer] > Path(outer).stat().st_size:
            raise OutputError("holds files larger than itself", source=outer)


def _members(archive: zipfile.ZipFile, name: str) -> list[str]:
    """List the files a name stands for: itself, or the tiles of a texture."""
    if UDIM not in name:
        return [name]
    before, _, after = name.partition(UDIM)
    tile = re.compile(re.escape(before) + r"\d{4}" + re.escape(after))
    found = sorted(filter(tile.fullmatch, archive.namelist()))
    if not found:
        raise KeyError(f"there is no tile {name}")
    return found


def _require_plain(info: zipfile.ZipInfo, package: str) -> None:
    kind = stat.S_IFMT(info.external_attr >> 16)
    if info.is_dir() or kind not in (0, stat.S_IFREG):
        raise OutputError(f"holds {info.filename!r}, which is no plain file", source=package)
    if info.compress_type != zipfile.ZIP_STORED or info.file_size != info.compress_size:
        raise OutputError(f"holds {info.filename!r} compressed: no .usdz may", source=package)


@contextmanager
def _opened(package: str) -> Iterator[zipfile.ZipFile]:
    """Open a package, which may lie in another."""
    outer, inner = package, ""
    if Ar.IsPackageRelativePath(package):
        outer, inner = Ar.SplitPackageRelativePathOuter(package)
    with ExitStack() as stack:
        path = Path(outer)
        if path.suffix.lower() != PACKAGE_SUFFIX or not path.is_file():
            raise OutputError("is no package", source=outer or package)
        archive = stack.enter_context(zipfile.ZipFile(path))
        while inner:
            name, inner = inner, ""
            if Ar.IsPackageRelativePath(name):
                name, inner = Ar.SplitPackageRelativePathOuter(name)
            info = archive.getinfo(name)
            _require_plain(info, package)
            stream = stack.enter_context(archive.open(info))
            archive = stack.enter_context(zipfile.ZipFile(stream))
        yield archive
