"""Animations as one OBJ file a frame: a folder, a glob pattern, or a single file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from meshmark.errors import InputError, MeshmarkError
from meshmark.files.reading import opened
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.frame_agreement import agreed
from meshmark.mesh.topology import Topology
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
        """Read what tells which files have the same connectivity, and one frame.

        Where almost all have the same, those that do not are bad frames, which raise when they
        are asked for, as do files that cannot be read. Faces that are none are left out with a
        note.

        Raises
        ------
        InputError
            If there is no OBJ file, or none of them can be read as a mesh; the first one's reason.
        """
        found = find_frames(source)
        files = ObjFiles(tuple(map(str, found.paths)), found.times)
        most = agreed(files.shapes())
        if most is not None:
            reference, strays = most
            files = replace(files, topology=files.topology_of(reference), strays=strays)
        first = _first_readable(files)
        flaw = first.topology.left_out
        animation = MeshAnimation(
            times=np.array(found.times),
            source=files,
            constant_topology=most is not None,
            origin=source,
            notes=(flaw,) if flaw else (),
            flaw=flaw,
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
    strays : tuple of int
        Files that do not share it, and are therefore not to be had.
    """

    paths: tuple[str, ...]
    times: tuple[float, ...]
    topology: Topology | None = None
    strays: tuple[int, ...] = ()

    def frame(self, index: int) -> Frame:
        """Parse file `index`."""
        with self._naming(index):
            text = self._text(index)
            V = text.points()
            topology = self.topology
            if topology is None or index in self.strays:
                topology = text.topology()
            if index in self.strays:
                raise InputError("other faces, or another number of vertices, than in most files")
            if len(V) != topology.n_points:
                raise InputError(
                    f"{len(V)} vertices where there were {topology.n_points}: "
                    "the file changed after it was first read"
                )
            return Frame(self.times[index], V, topology)

    def topology_of(self, index: int) -> Topology:
        """Parse the faces of file `index`."""
        with self._naming(index):
            return self._text(index).topology()

    def shapes(self) -> list[bytes | None]:
        """Digest the connectivity of each file; None where there is none."""
        known: dict[bytes, bytes | None] = {}
        return [self._shape(index, known) for index in range(len(self.paths))]

    def _shape(self, index: int, known: dict[bytes, bytes | None]) -> bytes | None:
        try:
            text = self._text(index)
        except InputError:
            return None
        written = text.fingerprint()
        # The same polygons may be written differently, or with other texture indices.
        if written not in known:
            try:
                known[written] = text.topology().digest()
            except InputError:
                known[written] = None
        return known[written]

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


def _first_readable(files: ObjFiles) -> Frame:
    """Read the first frame that can be; the first one's error if none can be."""
    errors: list[InputError] = []
    for index in range(len(files.paths)):
        try:
            return files.frame(index)
        except InputError as error:
            errors.append(error)
    raise errors[0]
