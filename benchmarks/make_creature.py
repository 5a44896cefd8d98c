"""Makes the demonstration's creature: models its body and its gallop, and writes both as data.

    python benchmarks/make_creature.py [-o FILE]

The same versions of numpy and scipy write the same bytes on one machine.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from creature.flesh import creature_flesh
from creature.gait import joint_angles, root_shift
from creature.skeleton import creature_skeleton
from creature.surface import rest_mesh
from creature.weights import nearness
from meshmark.demo.build import DATA, FRAMES, POINTS


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=DATA)
    np.savez_compressed(parser.parse_args(arguments).output, **model())


def model() -> dict[str, NDArray[np.generic]]:
    """Model the creature at every size, and its bones at every phase of the stride.

    Returns
    -------
    dict
        For each size `rest_*`, (N, 3) float64; `quad_steps_*`, (P, 4) uint16, the differences of
        successive quads modulo 2^16; `nearness_*`, (B, N) float64. `phases`, (T,) float64,
        sorted; `poses`, (T, B, 8) float64. Steps, and bones before points, compress better.
    """
    skeleton, flesh = creature_skeleton(), creature_flesh()
    phases = np.unique(np.concatenate([np.arange(n) / n for n in FRAMES]))
    poses = skeleton.pose(*joint_angles(skeleton, phases), root_shift(phases))
    made: dict[str, NDArray[np.generic]] = {"phases": phases, "poses": poses}
    for points in POINTS:
        V, Q = rest_mesh(flesh, points)
        made[f"rest_{points}"] = V
        made[f"quad_steps_{points}"] = np.diff(Q, axis=0, prepend=0).astype(np.uint16)
        made[f"nearness_{points}"] = np.ascontiguousarray(nearness(V, skeleton, flesh).T)
    return made


if __name__ == "__main__":
    main()
