"""All parts of a glTF document put together: its meshes where nodes place them, and its clips."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.errors import InputError, UsageError
from meshmark.mesh.asset import LeftOut
from meshmark_plugins.readers.gltf.accessors import Accessors
from meshmark_plugins.readers.gltf.buffers import Buffers
from meshmark_plugins.readers.gltf.clips import Clip, KeyTimes, clip_names, read_clip
from meshmark_plugins.readers.gltf.container import Container
from meshmark_plugins.readers.gltf.geometry import Geometry, Meshes
from meshmark_plugins.readers.gltf.nodes import read_nodes, scene_roots
from meshmark_plugins.readers.gltf.skins import Binding, Skin, bind, read_skin
from meshmark_plugins.readers.gltf.timeline import densest_rate

INSTANCES = "EXT_mesh_gpu_instancing"
MOST_NAMED = 10


@dataclass(frozen=True, eq=False)
class PlacedMesh:
    """The mesh of a node, without what changes over time.

    Parameters
    ----------
    node : int
    prim : str
        Path of the node.
    geometry : Geometry
    weights : (targets,) float64
        Of its morph targets.
    carriers : tuple of int
        Nodes that move it: the joints of its skin, if there is one, and the node itself.
    binding : Binding or None
        To the skin.
    extras : any JSON value
        What else is said of the mesh.
    """

    node: int
    prim: str
    geometry: Geometry
    weights: FloatArray
    carriers: tuple[int, ...]
    binding: Binding | None
    extras: object


class Document:
    """A glTF document.

    Parameters
    ----------
    container : Container
    folder : Path
        Where the files are that it names.

    Raises
    ------
    InputError
        From here and all methods, if something is not as it should be, naming its place.
    """

    def __init__(self, container: Container, folder: Path) -> None:
        root = container.root
        buffers = Buffers(container, folder)
        self.hierarchy = read_nodes(root)
        self._nodes, self._skins = root.objects("nodes"), root.objects("skins")
        self._animations = root.objects("animations")
        self._accessors = Accessors(root, buffers)
        self._key_times = KeyTimes(self._accessors)
        self._meshes = Meshes(root, self._accessors, buffers)
        # Nodes of the scene, in the order of a walk.
        self._shown = self.hierarchy.below(scene_roots(root, self.hierarchy))
        self._clip_names = clip_names(self._animations)
        self._skins_read: dict[int, Skin] = {}

    def meshes(self) -> tuple[list[PlacedMesh], list[LeftOut]]:
        """Read the meshes of the scene, and list what of it cannot be read.

        Raises
        ------
        InputError
            If there is none; that of the first that cannot be read.
        """
        placed: list[PlacedMesh] = []
        left_out: list[LeftOut] = []
        nodes = [node for node in self._shown if node in self.hierarchy.meshes]
        paths = self.hierarchy.paths(nodes)
        first: InputError | None = None
        for node in nodes:
            try:
                mesh = self._placed(node, paths[node])
            except InputError as error:
                first = first or error
                left_out.append(LeftOut(paths[node], error.message))
            else:
                placed += [] if mesh is None else [mesh]
                left_out += [LeftOut(paths[node], each) for each in self._lacking(node, mesh)]
        if not placed:
            raise first or InputError("holds no mesh of triangles")
        return placed, left_out

    def clip(self, name: str, meshes: list[PlacedMesh], *, strict: bool = True) -> Clip | None:
        """Read the clip of a name, or the first; None where there is none at all.

        Raises
        ------
        UsageError
            If there must be a clip of that name, and is none.
        """
        there = name != "" and name in self._clip_names
        if name and strict and not there:
            known = ", ".join(f"{each[:40]!a}" for each in self._clip_names[:MOST_NAMED])
            raise UsageError(f"no clip {name!r}; there is {known or 'none'}")
        if not self._animations:
            return None
        index = self._clip_names.index(name) if there else 0
        n_weights = {mesh.node: len(mesh.weights) for mesh in meshes}
        return read_clip(
            self._animations[index],
            self._clip_names[index],
            self._nodes,
            n_weights,
            self._key_times,
            self._accessors,
        )

    def densest_rate(self) -> float:
        """Return the rate of the densest keys of all clips, per second."""
        return densest_rate(self._key_times.of_all(self._animations))

    def notes(self, clip: Clip | None) -> list[str]:
        """Tell what a person should know about what is read."""
        notes = [] if clip is None else list(clip.notes)
        others = [name for name in self._clip_names if clip is None or name != clip.name]
        if clip is not None and others:
            named = ", ".join(f"{each[:40]!a}" for each in others[:MOST_NAMED])
            notes.append(f"clip {clip.name[:40]!a} is read; there is also {named}")
        unseen = len(self.hierarchy.meshes.keys() - self._shown)
        if unseen:
            notes.append(f"{unseen} meshes of other scenes are not read")
        return notes

    def _placed(self, index: int, prim: str) -> PlacedMesh | None:
        element, number = self._nodes[index], self.hierarchy.meshes[index]
        geometry = self._meshes.geometry(number)
        if geometry is None:
            return None
        n = len(geometry.vertices.targets)
        weighted = element if "weights" in element else self._meshes.elements[number]
        weights = np.array(weighted.numbers("weights", n, (0.0,) * n), dtype=np.float64)
        binding: Binding | None = None
        joints: tuple[int, ...] = ()
        if index in self.hierarchy.skins:
            skin = self._skin(self.hierarchy.skins[index])
            joints = skin.joints
            try:
                binding = bind(geometry.vertices, skin)
            except InputError as error:
                raise InputError(f"{element.place}: {error.message}") from None
        extras = self._meshes.elements[number].members.get("extras")
        return PlacedMesh(index, prim, geometry, weights, (*joints, index), binding, extras)

    def _skin(self, index: int) -> Skin:
        if index not in self._skins_read:
            self._skins_read[index] = read_skin(self._skins[index], self._nodes, self._accessors)
        return self._skins_read[index]

    def _lacking(self, node: int, mesh: PlacedMesh | None) -> list[str]:
        """Tell what of a node's mesh is not read."""
        passed_over = None if mesh is None else mesh.geometry.passed_over
        lacking = []
        if passed_over is None:
            lacking.append("it has points or lines, and no triangles")
        elif passed_over:
            lacking.append(f"{passed_over} of its primitives are points or lines")
        if self._nodes[node].extension(INSTANCES) is not None:
            lacking.append(f"its instances ({INSTANCES}) are not read, only the mesh itself")
        return lacking
