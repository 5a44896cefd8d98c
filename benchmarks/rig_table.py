"""Writes the table of docs/formats.md: marks on rigs, by what is written and what a leak shows.

usage: python benchmarks/rig_table.py FILE...

Every file is marked with the default layers, as far as it can hold them, and verified beside the
source and the master: from what was written, from copies in other formats, and from rigs that
others animated. Beside each stands what another key finds, and what is found in the unmarked
source after the same.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Usd, UsdSkel, Vt

from meshmark.detection.verify import verify
from meshmark.embedding.asset import MarkedAsset, embed
from meshmark.keys import Key
from meshmark.mesh.asset import Asset
from meshmark.sources.reading import read
from meshmark.sources.writing import writer

KEY, OTHER = Key(bytes(range(32))), Key(bytes(range(1, 33)))
EXAGGERATED = 1.3
# Every joint is turned by so many degrees more, in the mean square.
TURNED = 15.0

# Given the rotations of all samples, (T, J) quaternions, returns others.
Animate = Callable[[list[list[Gf.Quatf]]], list[list[Gf.Quatf]]]
# Makes a leak of an asset, marked or not, in a new folder.
Leak = Callable[[Asset, Path], Asset]


def backwards(rotations: list[list[Gf.Quatf]]) -> list[list[Gf.Quatf]]:
    """Show the same poses in reverse order."""
    return rotations[::-1]


def farther(first: Gf.Quatf, turned: Gf.Quatf) -> Gf.Quatf:
    """Turn a joint farther from its first rotation than it is turned."""
    near = turned if Gf.Dot(first, turned) >= 0 else -turned
    return Gf.Slerp(EXAGGERATED, first, near).GetNormalized()


def exaggerated(rotations: list[list[Gf.Quatf]]) -> list[list[Gf.Quatf]]:
    """Turn every joint farther from where it begins; the first pose stays."""
    return [
        [farther(first, turned) for first, turned in zip(rotations[0], sample, strict=True)]
        for sample in rotations
    ]


def posed_anew(rotations: list[list[Gf.Quatf]]) -> list[list[Gf.Quatf]]:
    """Turn every joint but the root by an angle of its own: poses that the source never takes."""
    rng = np.random.default_rng(0)
    more = [
        Gf.Quatf(Gf.Rotation(Gf.Vec3d(*axis), float(angle)).GetQuat())
        for axis, angle in zip(
            rng.normal(size=(len(rotations[0]), 3)),
            rng.normal(0.0, TURNED, len(rotations[0])),
            strict=True,
        )
    ]
    more[0] = Gf.Quatf(1.0)
    return [
        [(turned * turn).GetNormalized() for turned, turn in zip(sample, more, strict=True)]
        for sample in rotations
    ]


def animated(source: Path, animate: Animate, output: Path) -> None:
    """Exchange the rotations of all joints of a stage."""
    # A copy: USD shares layers that are open, and the source's must stay as they are.
    Usd.Stage.Open(str(source)).Export(str(output))
    stage = Usd.Stage.Open(str(output))
    for prim in stage.Traverse():
        if prim.IsA(UsdSkel.Animation):
            attribute = UsdSkel.Animation(prim).GetRotationsAttr()
            times = attribute.GetTimeSamples()
            found = animate([list(attribute.Get(time)) for time in times])
            for time, rotations in zip(times, found, strict=True):
                attribute.Set(Vt.QuatfArray(rotations), time)
    stage.Save()


def baked(source: Path, output: Path) -> None:
    """Let usd-core itself write the points that rigs give, as exporters do."""
    Usd.Stage.Open(str(source)).Export(str(output))
    stage = Usd.Stage.Open(str(output))
    UsdSkel.BakeSkinning(stage.Traverse())
    stage.Save()


class Ways:
    """Ways in which one source leaks.

    Parameters
    ----------
    source : Path
    parameters : dict
        Of its reader.
    """

    def __init__(self, source: Path, parameters: dict[str, Any]) -> None:
        self.source, self.parameters = source, parameters
        self.original = read(source, parameters=parameters)

    def all(self) -> Iterator[tuple[str, str, Leak]]:
        """Yield how each is written, what it shows, and the way."""
        if self.source.suffix in (".glb", ".gltf"):
            yield "as it was", "what was written", self.written(self.source.suffix)
            for clip in self.other_clips():
                yield "as it was", f"its clip {clip}", self.written(self.source.suffix, clip=clip)
            yield "a USD stage", "what was written", self.written(".usdc")
            return
        yield "`bake`", "the override", self.written(".usdc")
        yield "`bake`", "the deliverable", self.written(".usdc", deliver=True)
        yield "`bake`", "a new .glb", self.written(".glb")
        yield "`rest`", "the override", self.written(".usdc", skel="rest")
        yield "`rest`", "usd-core's own export", self.rig(baked)
        for animate in (backwards, exaggerated, posed_anew):
            name = f"the rig, {animate.__name__.replace('_', ' ')}"
            yield "`rest`", name, self.rig(lambda a, b, each=animate: animated(a, each, b))

    def other_clips(self) -> list[str]:
        """List the clips of a glTF file but the one that is marked."""
        if self.source.suffix == ".glb":
            data = self.source.read_bytes()
            document = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
        else:
            document = json.loads(self.source.read_text())
        return [each.get("name", "") for each in document.get("animations", [])[1:]]

    def written(self, suffix: str, clip: str | None = None, **how: Any) -> Leak:
        """Write in a format, and read it back."""

        def leak(asset: Asset, folder: Path) -> Asset:
            output = folder / f"leak{suffix}"
            writer(self.original, output, parameters=self.parameters, **how)(asset)
            return read(output, parameters={"clip": clip} if clip else None)

        return leak

    def rig(self, change: Callable[[Path, Path], None]) -> Leak:
        """Write the marked rest pose, change the stage, and read it."""

        def leak(asset: Asset, folder: Path) -> Asset:
            rest, output = folder / "rest.usdc", folder / "leak.usdc"
            writer(self.original, rest, skel="rest")(asset)
            change(rest, output)
            return read(output)

        return leak


def rows(source: Path) -> None:
    """Mark one file and print its rows."""
    ways = Ways(source, {})
    marked = embed(ways.original, KEY)
    layers = sorted({layer.scheme for mesh in marked.meshes for layer in mesh.layers})
    for how, shown, leak in ways.all():
        with tempfile.TemporaryDirectory() as name:
            print(f"| {' | '.join(_cells(ways, marked, layers, how, shown, leak, Path(name)))} |")
            sys.stdout.flush()


def _cells(
    ways: Ways,
    marked: MarkedAsset,
    layers: list[str],
    how: str,
    shown: str,
    leak: Leak,
    folder: Path,
) -> list[str]:
    for name in ("master", "marked", "unmarked"):
        (folder / name).mkdir()
    # The master is written like the copies: points that no rest pose has are in neither.
    master = _master(ways, marked, how, folder / "master")
    copies = [leak(marked.asset, folder / "marked"), leak(ways.original, folder / "unmarked")]
    found = [
        verify(copy, key, original=ways.original, master=master, frames="auto").log10_p
        for copy, key in ((copies[0], KEY), (copies[0], OTHER), (copies[1], KEY))
    ]
    name = f"`{ways.source.name}`, {' and '.join(layers)}"
    return [name, how, shown, *(f"{p:.1f}" for p in found)]


def _master(ways: Ways, marked: MarkedAsset, how: str, folder: Path) -> Asset:
    suffix = ways.source.suffix if how == "as it was" else ".usdc"
    skel = {"skel": "rest"} if how == "`rest`" else {}
    return ways.written(suffix, **skel)(marked.master, folder)


def main(files: list[Path]) -> None:
    """Print the table."""
    print("| file, layers | written | leak | log10 p | another key | unmarked |")
    print("|---|---|---|---|---|---|")
    for file in files:
        rows(file)


if __name__ == "__main__":
    main([Path(name) for name in sys.argv[1:]])
