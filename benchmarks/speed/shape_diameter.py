"""Shape diameters of one mesh: CGAL's `sdf_values` beside ours, in turns."""

from __future__ import annotations

import shutil
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshmark.arrays import FloatArray, IntArray

SOURCE = Path(__file__).resolve().parent / "cgal_sdf.cpp"
RAYS, CONE_ANGLE = 25, 120.0
RUNS = 3
SDF_VALUES = "CGAL's `sdf_values`"


class MissingError(Exception):
    """Something that a figure takes is not there; the message says what."""


@dataclass(frozen=True)
class Times:
    """CPU and wall seconds, medians."""

    cpu: float
    wall: float


class CGAL:
    """CGAL's side, compiled once against the system's headers (Debian: libcgal-dev).

    Parameters
    ----------
    folder : Path
        Where to build it.

    Raises
    ------
    MissingError
        If there is no g++, or CGAL is not installed.
    """

    def __init__(self, folder: Path) -> None:
        if shutil.which("g++") is None:
            raise MissingError("there is no g++")
        self._folder, self._program = folder, folder / "cgal_sdf"
        flags = ["-O3", "-DNDEBUG", "-std=c++17", "-lgmp", "-lmpfr"]
        command = ["g++", str(SOURCE), "-o", str(self._program), *flags]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            missing = "No such file" in done.stderr
            reason = "CGAL, GMP or MPFR is not installed"
            raise MissingError(reason if missing else done.stderr.strip()[-500:])

    def sdf_values(self, V: FloatArray, F: IntArray, *, smooth: bool = True) -> Times:
        """Time `sdf_values` alone, without writing or reading the mesh."""
        mesh, values = self._folder / "mesh.off", self._folder / "values.txt"
        with mesh.open("w", encoding="ascii") as file:
            file.write(f"OFF\n{len(V)} {len(F)} 0\n")
            np.savetxt(file, V, fmt="%.17g")
            np.savetxt(file, np.column_stack([np.full(len(F), 3), F]), fmt="%d")
        options = [RAYS, CONE_ANGLE, int(smooth), values]
        command = [str(self._program), str(mesh), *map(str, options)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        wall, cpu = map(float, done.stdout.split())
        return Times(cpu, wall)


def compare(cgal: CGAL | None, V: FloatArray, F: IntArray) -> dict[str, Times]:
    """Time shape diameters `RUNS` times in turns, so that a busy machine slows all alike.

    Ours are those of `shape_diameter`, checks and repair of missing values included. CGAL's are
    those of `sdf_values`, alone and with the smoothing it does by default, where it is there.
    """
    from meshmark_plugins.segmenters.sdf import shape_diameter

    def ours() -> Times:
        cpu, wall = time.process_time(), time.perf_counter()
        shape_diameter(V, F, cone_angle=CONE_ANGLE, rays=RAYS)
        return Times(time.process_time() - cpu, time.perf_counter() - wall)

    ours()  # the first call loads open3d
    sides: dict[str, Callable[[], Times]] = {"ours": ours}
    if cgal is not None:
        sides[SDF_VALUES] = lambda: cgal.sdf_values(V, F)
        sides["the same without smoothing"] = lambda: cgal.sdf_values(V, F, smooth=False)
    timed: dict[str, list[Times]] = {name: [] for name in sides}
    for _ in range(RUNS):
        for name, measure in sides.items():
            timed[name].append(measure())
    return {name: _median(times) for name, times in timed.items()}


def _median(times: list[Times]) -> Times:
    return Times(
        float(np.median([each.cpu for each in times])),
        float(np.median([each.wall for each in times])),
    )
