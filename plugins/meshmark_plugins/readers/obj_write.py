"""Writes OBJ sequences: a marked copy of what was read, or a new one from any animation."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray
from meshmark.errors import OutputError, UsageError
from meshmark.files.atomic import beside
from meshmark.files.reading import opened
from meshmark.mesh.animation import Frame
from meshmark.mesh.asset import Asset
from meshmark.mesh.precision import stored
from meshmark.mesh.topology import Topology
from meshmark_plugins.readers.obj_files import FrameFiles, find_frames
from meshmark_plugins.readers.obj_text import ObjText

# Enough for any time code of a second's fraction, and names stay far below what disks allow.
MOST_DECIMALS = 18


def write_marked(marked: Asset, original: Asset, output: Path) -> None:
    """Write the original's OBJ files with the positions of a marked copy.

    Only coordinates that changed are written anew, in as many digits as float32 needs; every
    other byte of every file stays. A frame the marked copy does not hold (it was marked over
    a range of frames only) is copied as it is.

    Parameters
    ----------
    marked, original : Asset
        One mesh each (none in `marked` if nothing was), the same vertices at the same times.
    output : Path
        A folder that does not exist yet or is empty; or, where the source is a single file, an
        .obj file.

    Raises
    ------
    OutputError
        If the output cannot be written, or is a folder that holds something already; if a point
        is not finite, or beyond what float32 holds.
    UsageError
        If an .obj file is asked for several frames, or the copy's vertices or times are not
        the original's.
    """
    found = find_frames(original.source)
    contents = _marked_contents(marked, found)
    if output.suffix.lower() == ".obj" and not output.is_dir():
        if not found.single:
            raise UsageError("several OBJ files need a folder to be written to", source=output)
        if output.resolve() == found.paths[0].resolve():
            raise UsageError("the output must not be the source itself", source=output)
        with _new_file(output) as place:
            place.write_bytes(next(contents))
        return
    with _new_folder(output) as place:
        for path, content in zip(found.paths, contents, strict=True):
            (place / path.name).write_bytes(content)


def write_new(asset: Asset, output: Path) -> None:
    """Write any asset as OBJ files: one a frame, named by its time code padded with zeros.

    Meshes become objects (`o` lines) of the same file. Times get a sign and decimals in the name
    where they need them, and are read back as they were; where a name cannot hold one, or there
    is none, frames are counted 1, 2, 3 and so on.

    Parameters
    ----------
    asset : Asset
        Meshes that share their time codes.
    output : Path
        A folder that does not exist yet or is empty; or, for a single frame, an .obj file.

    Raises
    ------
    OutputError
        If the output cannot be written, or is a folder that holds something already; if a point
        is not finite, or beyond what float32 holds.
    UsageError
        If the meshes have different times, or an .obj file is asked for several frames.
    """
    times = asset.meshes[0].times
    for mesh in asset.meshes:
        if not np.array_equal(mesh.times, times, equal_nan=True):
            raise UsageError(
                "its time codes differ from the other meshes', so they cannot share OBJ files",
                source=asset.source,
                prim=mesh.prim,
            )
    if output.suffix.lower() == ".obj" and not output.is_dir():
        if len(times) > 1:
            raise UsageError("several frames need a folder to be written to", source=output)
        with _new_file(output) as place:
            place.write_bytes(_frame_text(asset, 0))
        return
    with _new_folder(output) as place:
        for index, name in enumerate(_frame_names(times)):
            (place / name).write_bytes(_frame_text(asset, index))


def _marked_contents(marked: Asset, found: FrameFiles) -> Iterator[bytes]:
    frames = {
        _clock_key(time): (mesh, index)
        for mesh in marked.meshes
        for index, time in enumerate(mesh.times)
    }
    for key in frames.keys() - {_clock_key(time) for time in found.times}:
        raise UsageError(
            f"the marked copy holds frame {key}, which the original does not", source=marked.source
        )
    for path, time in zip(found.paths, found.times, strict=True):
        data = _read(path)
        if _clock_key(time) in frames:
            mesh, index = frames[_clock_key(time)]
            data = _with_points(data, mesh[index], path)
        yield data


def _clock_key(time: float) -> str:
    # NaN, the time of a single file, is not equal to itself; its name is.
    return repr(float(time))


def _with_points(data: bytes, frame: Frame, path: Path) -> bytes:
    text = ObjText(data)
    if text.n_points != len(frame.points):
        raise UsageError(
            f"the marked copy has {len(frame.points)} vertices, the original {text.n_points}",
            source=path,
            time=frame.time,
        )
    try:
        return text.with_points(frame.points)
    except OutputError as error:
        raise OutputError(error.message, source=path, time=frame.time) from None


def _read(path: Path) -> bytes:
    with opened(path) as file:
        return file.read()


def _frame_names(times: FloatArray) -> list[str]:
    """Name files so that they read back as these times, or else as 1, 2, 3 and so on."""
    decimals = next((n for n in range(MOST_DECIMALS) if _holds(times, n)), None)
    if decimals is None:
        times, decimals = np.arange(1.0, len(times) + 1), 0
    digits = max(4, *(len(str(int(abs(time)))) for time in times))
    width = digits + (decimals + 1 if decimals else 0)
    return [f"{time:0{width + (time < 0)}.{decimals}f}.obj" for time in times]


def _holds(times: FloatArray, decimals: int) -> bool:
    """Tell whether times can be spelled with so many decimals."""
    return all(float(f"{time:.{decimals}f}") == time for time in times.tolist())


def _frame_text(asset: Asset, index: int) -> bytes:
    parts = []
    offset = 1
    for mesh in asset.meshes:
        frame = mesh[index]
        if len(asset.meshes) > 1:
            parts.append(f"o {mesh.prim}\n")
        V = stored(frame.points, np.float32, source=mesh.origin, prim=mesh.prim, time=frame.time)
        parts += [_vertex_lines(V), _face_lines(frame.topology, offset)]
        offset += len(frame.points)
    return "".join(parts).encode()


def _vertex_lines(V: NDArray[np.floating]) -> str:
    words = V.ravel().astype("U").tolist()
    return ("v %s %s %s\n" * len(V)) % tuple(words)


def _face_lines(topology: Topology, offset: int) -> str:
    lines = {int(n): "f" + " %d" * int(n) + "\n" for n in np.unique(topology.counts)}
    template = "".join(map(lines.__getitem__, topology.counts.tolist()))
    return template % tuple((topology.indices + offset).tolist())


@contextmanager
def _new_folder(output: Path) -> Iterator[Path]:
    """Give a folder beside the output, which takes its place once it is complete."""
    if output.exists() and (not output.is_dir() or any(output.iterdir())):
        raise OutputError("exists already and is not an empty folder", source=output)
    with beside(output) as place:
        place.mkdir()
        yield place
        if output.exists():
            output.rmdir()
        place.rename(output)


@contextmanager
def _new_file(output: Path) -> Iterator[Path]:
    """Give a file beside the output, which takes its place once it is complete."""
    with beside(output) as place:
        yield place
        place.replace(output)
