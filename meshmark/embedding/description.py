"""What the manifest of a marked file tells: the source, and each mesh, as JSON values."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from meshmark.detection.verdict import PrimVerdict, Verdict
from meshmark.embedding.asset import MarkedAsset, MarkedMesh
from meshmark.embedding.checks import (
    TARGET_FPR,
    checked_frames,
    measure_distortion,
    told_of_limit,
)
from meshmark.embedding.manifest import FORMAT
from meshmark.extension.recipe import Recipe
from meshmark.files.atomic import number
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.metrics import Distortion
from meshmark.sources.digests import file_hashes
from meshmark.sources.facts import texture_coordinates
from meshmark.usd.names import KEEP, READER
from meshmark.usd.stamp import Stamp
from meshmark.version import __version__

# What says nothing of the marks.
PLACES = ("source", "output", "asked")


def describe_run(
    original: Asset,
    files: Sequence[tuple[str, str]],
    output: Path,
    *,
    key: Key,
    parameters: Mapping[str, Any] | None,
    layers: Sequence[Recipe],
    recipient: str | None,
    frames: str | None,
    deliver: bool,
    skel: str,
    primvars: str,
    asked: Mapping[str, Any],
) -> dict[str, Any]:
    """Tell what is to be marked, as whose copy and how: all that decides what comes of it.

    Parameters
    ----------
    original : Asset
        As it was read.
    files : sequence of (str, str)
        Those of the source; see `meshmark.sources.digests.source_digests`. They are named
        relative to the folder of the output.
    parameters : mapping or None
        Of the source's reader, where some were given.
    asked : mapping
        What else was asked for, as JSON values.
    """
    folder = output.parent.resolve()
    path = Path(os.path.relpath(original.source, folder)).as_posix()
    source: dict[str, Any] = {"path": path, "files": file_hashes(files, folder)}
    if parameters:
        source["parameters"] = dict(parameters)
    if original.variants:
        source["variants"] = list(original.variants)
    return {
        "format": FORMAT,
        "meshmark": __version__,
        "source": source,
        "output": output.name,
        "delivered": deliver,
        "skel": skel,
        "primvars": primvars,
        "key_id": key.id,
        "recipient": recipient,
        "frames": frames,
        "plugins": layers[0].as_json(),
        "layers": [layer.as_json()["scheme"] for layer in layers],
        "asked": dict(asked),
    }


def record_of(document: Mapping[str, Any], marked: MarkedAsset, key: Key) -> str:
    """Name a run, as `describe_run` tells of it, by 32 hexadecimal digits.

    The same marks in the same source have the same name, wherever the files lie. Nobody can guess
    it, or what it stands for, without the key.
    """
    source = document["source"]
    said = {
        **{name: value for name, value in document.items() if name not in PLACES},
        "files": [each["sha256"] for each in source["files"]],
        "parameters": source.get("parameters"),
        "meshes": [mesh.original.prim for mesh in marked.meshes],
    }
    return key.derive(f"record/{json.dumps(said, sort_keys=True)}", 16).hex()


def stamps_told(document: Mapping[str, Any]) -> dict[str, Stamp]:
    """Return the stamps a manifest tells of, by mesh; none if none were asked for."""
    asked = document.get("asked")
    # What was asked for is missing in older manifests: their records are of stamps.
    unstamped = isinstance(asked, dict) and asked.get("stamp") is False
    if "record" not in document or unstamped:
        return {}
    return {
        str(prim["prim"]): Stamp(
            str(document["record"]), tuple(str(layer["scheme"]) for layer in prim["layers"])
        )
        for prim in document["prims"]
    }


@dataclass(frozen=True, eq=False)
class MeasureMarks:
    """Measures how far each mesh was moved; picklable, for a worker process.

    Parameters
    ----------
    meshes : sequence of MarkedMesh
    shown : sequence of MeshAnimation
        As they were written.
    coordinates : sequence of dict
        Their texture coordinates, as `distortion` takes them.
    layers : sequence of Recipe
        What they were marked by.
    check_all : bool
        Whether all frames are compared.
    """

    meshes: Sequence[MarkedMesh]
    shown: Sequence[MeshAnimation]
    coordinates: Sequence[dict[str, Any]]
    layers: Sequence[Recipe]
    check_all: bool

    @classmethod
    def of(
        cls,
        marked: MarkedAsset,
        written: Asset,
        layers: Sequence[Recipe],
        *,
        primvars: str,
        check_all: bool,
    ) -> MeasureMarks:
        """Get ready to measure what was marked.

        Parameters
        ----------
        marked : MarkedAsset
            As it was marked; its original as it was read.
        written : Asset
            The marked meshes as they were written, in the same order.
        primvars : {"follow", "keep"}
            Whether texture coordinates are others in what was written.
        """
        coordinates = [
            _coordinates(marked.original, written, mesh.original.prim, primvars)
            for mesh in marked.meshes
        ]
        return cls(marked.meshes, written.meshes, coordinates, layers, check_all)

    def __call__(self, jobs: int) -> list[Distortion]:
        """Measure all, in so many processes."""
        return [
            measure_distortion(
                mesh, shown, textures, self.layers, check_all=self.check_all, jobs=jobs
            )
            for mesh, shown, textures in zip(self.meshes, self.shown, self.coordinates, strict=True)
        ]


def describe_marks(
    marked: MarkedAsset,
    verdict: Verdict,
    distortions: Sequence[Distortion],
    *,
    layers: Sequence[Recipe],
    check_all: bool,
) -> dict[str, Any]:
    """Tell of each marked mesh how far it was moved, and what verification says of it.

    Parameters
    ----------
    marked : MarkedAsset
    verdict : Verdict
        On what was written, at `TARGET_FPR`.
    distortions : sequence of Distortion
        Of each mesh; see `MeasureMarks`.
    layers : sequence of Recipe
        What it was marked by.
    check_all : bool
        Whether all frames were verified.
    """
    verdicts = {prim.prim: prim for prim in verdict.prims}
    return {
        "prims": [
            {
                **_mesh(mesh, verdicts.get(mesh.animation.prim)),
                "notes": [*mesh.animation.notes, *told_of_limit(each, layers)],
                "checked_frames": len(checked_frames(mesh, check_all)),
                "distortion": {name: number(value) for name, value in vars(each).items()},
            }
            for mesh, each in zip(marked.meshes, distortions, strict=True)
        ],
        "verification": {
            "verdict": verdict.verdict,
            "log10_p": verdict.log10_p,
            "fpr": TARGET_FPR,
        },
    }


def _coordinates(asset: Asset, written: Asset, prim: str, primvars: str) -> dict[str, Any]:
    """Return the texture coordinates of a mesh before, and those after if they may be others."""
    if not asset.mesh(prim).constant_topology:
        # There are others in every run of frames.
        return {}
    if asset.reader == READER != written.reader:
        # A new file of another format holds none.
        return {}
    if primvars == KEEP or asset.reader != READER or written.source == asset.source:
        return {"uv": texture_coordinates(asset, prim)}
    from meshmark.usd.texture_coordinates import TextureCoordinates

    before, after = (
        TextureCoordinates(each.source, prim, each.variants) for each in (asset, written)
    )
    return {"uv": before, "marked_uv": after}


def _mesh(mesh: MarkedMesh, verdict: PrimVerdict | None) -> dict[str, Any]:
    first = mesh.original[0]
    told = None if verdict is None else verdict.as_json()
    kept = ("verdict", "log10_p", "chips", "ber")
    return {
        "prim": mesh.animation.prim,
        "points": first.topology.n_points,
        "faces": len(first.topology.counts),
        "frames": len(mesh.original),
        "marked_frames": len(mesh.frames),
        "passed_over": [
            {"time": number(time), "reason": error.message} for time, error in mesh.passed_over
        ],
        "carriers": mesh.carriers,
        "layers": [{"scheme": layer.scheme, "carriers": layer.carriers} for layer in mesh.layers],
        "missing": [{"scheme": name, "reason": reason} for name, reason in mesh.missing],
        "verification": None if told is None else {name: told[name] for name in kept},
    }
