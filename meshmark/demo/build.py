"""The galloping creature as an animation in memory, and as a USD stage."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from meshmark.demo.flesh import creature_flesh
from meshmark.demo.gait import joint_angles, root_shift
from meshmark.demo.skeleton import creature_skeleton
from meshmark.demo.skinning import skin, skin_weights
from meshmark.demo.surface import rest_mesh
from meshmark.errors import OutputError, UsageError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.topology import Topology

PRIM = "/Creature/Geom/body"
FILE_NAME = "creature.usdc"

_FEWEST_POINTS, _MOST_POINTS = 3000, 40000


def creature(points: int = 7000, frames: int = 24) -> MeshAnimation:
    """Build a horse-like creature that gallops: one stride, which loops.

    A closed quad mesh of one piece and genus 0, in centimetres, Y up, facing +X. The gallop is
    on a treadmill: the body stays, the ground would go back by `gait.STRIDE` a stride.

    Parameters
    ----------
    points : int
        Wanted number of points, 3000 to 40000; met within about 5 %. Below some 6000 the skin
        may be creased at the tips of the ears and the edges of the hooves.
    frames : int
        Frames of the stride, at time codes 1, 2, ...; the frame after the last is the first.

    Returns
    -------
    MeshAnimation
        With the prim path "/Creature/Geom/body". The same on every call.

    Raises
    ------
    UsageError
        If there are to be no frames, or too few or too many points.

    Examples
    --------
    >>> from meshmark.demo import creature
    >>> animation = creature(frames=8)
    >>> len(animation), animation.constant_topology
    (8, True)
    """
    if frames < 1:
        raise UsageError(f"an animation needs at least one frame, not {frames}")
    if not _FEWEST_POINTS <= points <= _MOST_POINTS:
        raise UsageError(
            f"the creature has {_FEWEST_POINTS} to {_MOST_POINTS} points, not {points}"
        )
    skeleton, flesh = creature_skeleton(), creature_flesh()
    V, Q = rest_mesh(flesh, points)
    topology = Topology(np.full(len(Q), 4), Q.reshape(-1), len(V))
    F = topology.triangles
    phase = np.arange(frames) / frames
    bones = skeleton.pose(*joint_angles(skeleton, phase), root_shift(phase))
    posed = skin(V, F, skin_weights(V, F, skeleton, flesh), *bones)
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
