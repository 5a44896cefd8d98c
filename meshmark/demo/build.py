"""The galloping creature as an animation in memory, and as a USD stage."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from meshmark.demo.skinning import skin, skin_weights
from meshmark.errors import OutputError, UsageError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.topology import Topology

PRIM = "/Creature/Geom/body"
FILE_NAME = "creature.usdc"

# Written by benchmarks/make_creature.py: for each size the rest mesh and how near each bone is to
# each vertex, and the poses of the bones over the stride.
DATA = Path(__file__).with_name("creature.npz")
POINTS = (3000, 7000)
FRAMES = (1, 2, 3, 4, 6, 8, 12, 17, 24)


def creature(points: int = 7000, frames: int = 24) -> MeshAnimation:
    """Pose a horse-like creature that gallops: one stride, which loops.

    A closed quad mesh of one piece and genus 0, in centimetres, Y up, facing +X. The gallop is
    on a treadmill: the body stays, the ground would go back by 440 cm a stride.

    Parameters
    ----------
    points : int
        About how many points: 3000 or 7000. With 3000 the skin may be creased at the tips of
        the ears and the edges of the hooves.
    frames : int
        Frames of the stride, one of `FRAMES`, at time codes 1, 2, ...; the frame after the last
        is the first.

    Returns
    -------
    MeshAnimation
        With the prim path "/Creature/Geom/body". The same on every call.

    Raises
    ------
    UsageError
        If the creature does not come with so many points or frames.

    Examples
    --------
    >>> from meshmark.demo import creature
    >>> animation = creature(frames=8)
    >>> len(animation), animation.constant_topology
    (8, True)
    """
    for wanted, offered, what in ((points, POINTS, "points"), (frames, FRAMES, "frames")):
        if wanted not in offered:
            choice = ", ".join(map(str, offered))
            raise UsageError(f"the creature's number of {what} is one of {choice}; not {wanted}")
    with np.load(DATA, allow_pickle=False) as data:
        V = data[f"rest_{points}"]
        indices = np.cumsum(data[f"quad_steps_{points}"], axis=0, dtype=np.uint16).reshape(-1)
        nearness = np.ascontiguousarray(data[f"nearness_{points}"].T)
        poses = data["poses"][np.isin(data["phases"], np.arange(frames) / frames)]
    topology = Topology(np.full(len(indices) // 4, 4), indices.astype(np.int64), len(V))
    F = topology.triangles
    posed = skin(V, F, skin_weights(nearness, F), poses)
    return MeshAnimation.from_frames(
        [Frame(float(t + 1), P, topology) for t, P in enumerate(posed)], prim=PRIM
    )


def write_creature(output: Path, points: int = 7000, frames: int = 24) -> Path:
    """Write the galloping creature as a USD stage of its own.

    Parameters
    ----------
    output : Path
        A .usd, .usdc or .usda file to write, or a folder to write "creature.usdc" into, made
        if it is not there.
    points, frames : int
        As for `creature`.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    OutputError
        If the place cannot be written to.
    UsageError
        As for `creature`.
    """
    from meshmark.usd.stages import write_stage

    output = Path(output)
    target = output if output.suffix in {".usd", ".usda", ".usdc"} else output / FILE_NAME
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot make the folder: {error.strerror}", source=target) from error
    animation = creature(points, frames)
    asset = Asset(source=str(target), meshes=(animation,), reader="demo")
    write_stage(asset, target)
    return target
