"""The reader of glTF files, which writes them back."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from meshmark.errors import InputError, UsageError
from meshmark.files.places import require_apart
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark_plugins.readers.gltf.clips import Row
from meshmark_plugins.readers.gltf.container import (
    BINARY_SUFFIX,
    TEXT_SUFFIX,
    Container,
    read_container,
    spelled,
)
from meshmark_plugins.readers.gltf.document import Document, PlacedMesh
from meshmark_plugins.readers.gltf.frames import GltfFrames
from meshmark_plugins.readers.gltf.grids import require_fine
from meshmark_plugins.readers.gltf.new import write_new, written_paths
from meshmark_plugins.readers.gltf.output import files_beside
from meshmark_plugins.readers.gltf.places import find_places
from meshmark_plugins.readers.gltf.plain import uncompressed
from meshmark_plugins.readers.gltf.poses import Rig, rig_of, weights_row
from meshmark_plugins.readers.gltf.timeline import (
    FASTEST,
    STILL,
    Timeline,
    frames_of,
    told_frames,
)
from meshmark_plugins.readers.gltf.uris import buffer_files, files_named
from meshmark_plugins.readers.gltf.writing import write_marked

NAME = "gltf"
SUFFIXES = (BINARY_SUFFIX, TEXT_SUFFIX)


@dataclass(frozen=True)
class GltfReader:
    """Reads .glb and .gltf files of version 2, compressed or not.

    Each node that has a mesh is one mesh here, with all triangles of its primitives, at the path
    of the node. Nodes are those of the default scene, else of the first, else all. Time code 0 is
    at 0 s, and frames are at whole time codes.

    Parameters
    ----------
    clip : str
        Name of the animation to read; the first by default.
    fps : float
        Time codes per second; by default as many as the densest keys of the file.
    uncompress : bool
        Write plain floats where the source is compressed, quantised or sparse.
    strict : bool
        Whether there must be such a clip; without, the first is read where there is none.

    Notes
    -----
    glTF's unit is the metre, and Y is up.
    """

    clip: str = ""
    fps: float = 0.0
    uncompress: bool = False
    strict: bool = True

    def __post_init__(self) -> None:
        if not 0.0 <= self.fps <= FASTEST:
            raise UsageError(f"fps must lie between 0 and {FASTEST:g}, not {self.fps:g}")

    def accepts(self, source: str) -> bool:
        """Tell whether the source is called as glTF files are."""
        return Path(source).suffix.lower() in SUFFIXES

    def read(self, source: str) -> Asset:
        """Read all but the points of frames, which are computed when asked for.

        Meshes that cannot be read are left out while there are others.

        Raises
        ------
        InputError
            If the file or what it is made of cannot be read, or no mesh of it can.
        UsageError
            If there is no such clip.
        """
        with _naming(source):
            return self._read(source)

    def files(self, source: str) -> list[Path]:
        """List the file, and those of its buffers, sorted."""
        path = Path(source)
        with _naming(source):
            return sorted([path, *buffer_files(read_container(path).root, path.parent)])

    def files_in_reach(self, source: str) -> list[Path]:
        """List the file, and all that it names, buffers and images; none if it is missing."""
        path = Path(source)
        found = [path] if path.is_file() else []
        # What cannot be read is told of when it is needed.
        with suppress(InputError):
            found += files_named(read_container(path).root, path.parent)
        return found

    def writes(self, output: Path) -> bool:
        """Tell whether the output is called as glTF files are."""
        return output.suffix.lower() in SUFFIXES

    def require_writable(self, source: str, output: Path) -> None:
        """Refuse a source whose positions cannot be replaced, or would lose a mark.

        See `places.find_places` and `grids.require_fine`.

        Raises
        ------
        OutputError
            If a buffer beside the output would take the place of a file that the source uses.
        """
        path = Path(source)
        with _naming(source):
            container = self._to_write(path)
            find_places(container, path.parent)
            require_fine(container, path.parent)
            # What else is written again must be sound, too.
            files_named(container.root, path.parent)
            spelled(container.root.members)
        require_apart(files_beside(output, container.root), self.files_in_reach(source))

    def write(self, marked: Asset, original: Asset, output: Path) -> None:
        """Write the source with positions whose frames come nearest; see `writing.write_marked`."""
        path = Path(original.source)
        plain = {mesh.prim: mesh.source for mesh in self.read(original.source).meshes}
        with _naming(original.source):
            pairs = [
                (frames, mesh)
                for mesh in marked.meshes
                if isinstance(frames := plain.get(mesh.prim), GltfFrames)
            ]
            write_marked(path, self._to_write(path), pairs, output)

    def write_new(self, asset: Asset, output: Path) -> None:
        """Write any asset as a new file; see `new.write_new`."""
        write_new(asset, output)

    def written_names(self, original: Asset) -> dict[str, str]:
        """Map the name of each mesh to its name in what is written."""
        if original.reader != NAME:
            return written_paths(original)
        return {mesh.prim: mesh.prim for mesh in original.meshes}

    def _to_write(self, path: Path) -> Container:
        container = read_container(path)
        return uncompressed(container, path.parent) if self.uncompress else container

    def _read(self, source: str) -> Asset:
        path = Path(source)
        document = Document(read_container(path), path.parent)
        meshes, left_out = document.meshes()
        clip = document.clip(self.clip, meshes, strict=self.strict)
        tracks = {mesh.prim: weights_row(clip, mesh.node) for mesh in meshes}
        told = {} if self.fps else _told(meshes, tracks)
        fps = self.fps or next((each.fps for each in told.values()), document.densest_rate())
        timeline = None if clip is None or not clip.tracks else frames_of(clip, fps)
        return Asset(
            source=source,
            meshes=tuple(
                _animation(
                    mesh,
                    rig_of(document.hierarchy, clip, mesh.carriers),
                    tracks[mesh.prim],
                    told.get(mesh.prim, timeline),
                    source,
                )
                for mesh in meshes
            ),
            reader=NAME,
            up_axis="Y",
            meters_per_unit=1.0,
            fps=fps,
            notes=tuple(document.notes(clip)),
            left_out=tuple(left_out),
        )


@contextmanager
def _naming(source: str) -> Iterator[None]:
    """Say in errors which file they are about."""
    try:
        yield
    except (InputError, UsageError) as error:
        raise type(error)(
            error.message, source=error.source or source, prim=error.prim, time=error.time
        ) from None


def _told(meshes: Sequence[PlacedMesh], tracks: Mapping[str, Row | None]) -> dict[str, Timeline]:
    """Return the frames that meshes say they have, by their paths; none if rates differ."""
    told = {}
    for mesh in meshes:
        track = tracks[mesh.prim]
        found = None if track is None else told_frames(mesh.extras, track[0].times)
        if found is not None:
            told[mesh.prim] = found
    return told if len({each.fps for each in told.values()}) == 1 else {}


def _animation(
    mesh: PlacedMesh,
    rig: Rig,
    track: Row | None,
    timeline: Timeline | None,
    source: str,
) -> MeshAnimation:
    """Return a mesh over time; at no time if nothing of it changes."""
    moves = timeline is not None and (track is not None or rig.tracks)
    timeline = timeline if timeline is not None and moves else STILL
    frames = GltfFrames(
        geometry=mesh.geometry,
        weights=mesh.weights,
        weights_row=track,
        rig=rig,
        binding=mesh.binding,
        timeline=timeline,
        source=source,
        prim=mesh.prim,
    )
    flaw = mesh.geometry.topology.left_out
    return MeshAnimation(
        times=timeline.codes,
        source=frames,
        prim=mesh.prim,
        origin=source,
        notes=(*_rigged(mesh), *((flaw,) if flaw else ())),
        flaw=flaw,
    )


def _rigged(mesh: PlacedMesh) -> tuple[str, ...]:
    """Say what poses a mesh, beside its node."""
    # The last of the binding's matrices is the node's.
    joints = 0 if mesh.binding is None else len(mesh.binding.inverse_bind) - 1
    found = {"joints": joints, "morph targets": len(mesh.weights)}
    told = " and ".join(f"{number} {kind}" for kind, number in found.items() if number)
    return (f"rigged: posed by {told}",) if told else ()
