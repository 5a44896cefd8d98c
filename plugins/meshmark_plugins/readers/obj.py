"""Animations as one OBJ file a frame: a folder, a glob pattern, or a single file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from meshmark.animation import Asset, Frame, MeshAnimation, Topology
from meshmark.errors import InputError, MeshmarkError
from meshmark.files import opened
from meshmark_plugins.readers.obj_files import find_frames, looks_like_frames
from meshmark_plugins.readers.obj_text import ObjText
from meshmark_plugins.readers.obj_write import write_marked, write_new

NAME = "obj"


class ObjFrames:
    """Reads OBJ sequences, and writes them back with other positions.

    All objects and groups of a file are one mesh, at prim "/". Times are the numbers the file
    names end in, see `find_frames`; a single file has none (NaN). Texture coordinates, normals,
    materials and lines are left alone.

    Notes
    -----
    OBJ knows no unit, frame rate or up axis; the asset says centimetres, 24 and Y.
    """

    def accepts(self, source: str) -> bool:
        """Tell whether the source is an .obj file or pattern, or a folder that holds one."""
        return looks_like_frames(source)

    def read(self, source: str) -> Asset:
        """Read the first frame, and what tells whether the others have its connectivity.

        Raises
        ------
        InputError
            If there is no OBJ file, one cannot be read, or the first frame is no mesh; other
            frames report what is wrong with them when they are asked for.
        """
        found = find_frames(source)
        files = ObjFiles(tuple(map(str, found.paths)), found.times)
        topology = files.frame(0).topology
        constant = _all_share(files, topology)
        frames = replace(files, topology=topology) if constant else files
        animation = MeshAnimation(
            times=np.array(found.times), source=frames, constant_topology=constant, origin=source
        )
        return Asset(source=source, meshes=(animation,), reader=NAME)

    def writes(self, output: Path) -> bool:
        """Tell whether the output names a folder, or an .obj file."""
        return output.suffix.lower() in ("", ".obj") or output.is_dir()

    def write(self, marked: Asset, original: Asset, output: Path) -> None:
        """Write the original's files with the marked positions; see `write_marked`."""
        write_marked(marked, original, output)

    def write_new(self, asset: Asset, output: Path) -> None:
        """Write any asset as OBJ files; see `obj_write.write_new`."""
        write_new(asset, output)


@dataclass(frozen=True, eq=False)
class ObjFiles:
    """Frames that lie in one OBJ file each.

    Parameters
    ----------
    paths : tuple of str
        The files, in time order.
    times : tuple of float
        Their time codes.
    topology : Topology, optional
        What all files share, so that faces need not be parsed again.
    """

    paths: tuple[str, ...]
    times: tuple[float, ...]
    topology: Topology | None = None

    def frame(self, index: int) -> Frame:
        """Parse file `index`."""
        with self._naming(index):
            text = self._text(index)
            V = text.points()
            topology = text.topology() if self.topology is None else self.topology
            if len(V) != topology.n_points:
                raise InputError(
                    f"{len(V)} vertices where there were {topology.n_points}: "
                    "the file changed after it was first read"
                )
            return Frame(self.times[index], V, topology)

    def fingerprint(self, index: int) -> bytes:
        """Digest the connectivity of file `index` without parsing it."""
        with self._naming(index):
            return self._text(index).fingerprint()

    def _text(self, index: int) -> ObjText:
        with opened(Path(self.paths[index])) as file:
            return ObjText(file.read())

    @contextmanager
    def _naming(self, index: int) -> Iterator[None]:
        try:
            yield
        except MeshmarkError as error:
            time = self.times[index]
            raise type(error)(error.message, source=self.paths[index], time=time) from error


def _all_share(files: ObjFiles, topology: Topology) -> bool:
    """Tell whether all files have the connectivity of the first, in the same order."""
    first = files.fingerprint(0)
    for index in range(1, len(files.paths)):
        if files.fingerprint(index) == first:
            continue
        # The same polygons may be written differently, or with other texture indices.
        if not files.frame(index).topology.same_as(topology):
            return False
    return True
