"""Writes the table of docs/formats.md: marks on rigs, by what is written and what a leak shows.

usage: python benchmarks/rig_table.py FILE...

Every rigged stage is marked with the default layers, baked and in its rest pose, and verified
beside the source and the master, from what was written and from rigs that others animated.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from pxr import Gf, Usd, UsdSkel, Vt

from meshmark.detection.verify import verify
from meshmark.embedding.asset import embed
from meshmark.keys import Key
from meshmark.mesh.asset import Asset
from meshmark.metrics import distortion
from meshmark.usd.reading import read_stage
from meshmark.usd.writing import write_override

EXAGGERATED = 1.3

# Given the rotations of all samples, (T, J) quaternions, returns others.
Animate = Callable[[list[list[Gf.Quatf]]], list[list[Gf.Quatf]]]


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


def animated(source: Path, animate: Animate, output: Path) -> Asset:
    """Exchange the rotations of all joints of a stage."""
    stage = Usd.Stage.Open(str(source))
    for prim in stage.Traverse():
        if prim.IsA(UsdSkel.Animation):
            attribute = UsdSkel.Animation(prim).GetRotationsAttr()
            times = attribute.GetTimeSamples()
            found = animate([list(attribute.Get(time)) for time in times])
            for time, rotations in zip(times, found, strict=True):
                attribute.Set(Vt.QuatfArray(rotations), time)
    stage.Export(str(output))
    return read_stage(str(output))


def rows(file: Path, folder: Path) -> None:
    """Mark one file and print its rows."""
    key, original = Key(bytes(range(32))), read_stage(str(file))
    marked = embed(original, key)
    layers = " and ".join(layer.scheme for layer in marked.meshes[0].layers)
    name = f"`{file.name}`, {layers}"
    for skel in ("bake", "rest"):
        place, master = (folder / f"{file.stem}-{skel}{end}.usdc" for end in ("", "-master"))
        write_override(original, marked.asset, place, skel=skel)
        write_override(original, marked.master, master, skel=skel)
        written, beside = read_stage(str(place)), read_stage(str(master))
        leaks = {"what was written": lambda written=written: written}
        if skel == "rest":
            for animate in (backwards, exaggerated):
                other = folder / f"{file.stem}-{animate.__name__}.usdc"
                leaks[f"the rig, {animate.__name__}"] = lambda a=animate, o=other, p=place: (
                    animated(p, a, o)
                )
        mrms = distortion(original.meshes[0], written.meshes[0]).mrms_rel
        for leak, made in leaks.items():
            found = verify(made(), key, original=original, master=beside, frames="auto")
            cells = (name, f"`{skel}`", f"{mrms:.2e}", leak, f"{found.log10_p:.1f}")
            print(f"| {' | '.join(cells)} |", flush=True)


def main(files: list[Path]) -> None:
    """Print the table."""
    print("| file, layers | `--skel` | MRMS | leak | log10 p |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        for file in files:
            rows(file, Path(name))


if __name__ == "__main__":
    main([Path(name) for name in sys.argv[1:]])
