"""What the rows of the table of speed share."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from measuring import Run, run
from meshmark import Key, read
from meshmark.mesh.animation import MeshAnimation
from speed.shape_diameter import CGAL, MissingError, Times


@dataclass(frozen=True)
class Line:
    """One line of the table; None where a column says nothing.

    Parameters
    ----------
    figure : str
        What was measured.
    cpu, wall : float, optional
        Seconds.
    peak_mb, private_mb : float, optional
        See `measuring.Run`.
    unit : Times, optional
        One `sdf_values` of CGAL, to put the seconds in relation to.
    """

    figure: str
    cpu: float | None = None
    wall: float | None = None
    peak_mb: float | None = None
    private_mb: float | None = None
    unit: Times | None = None

    @classmethod
    def of(cls, figure: str, done: Run, unit: Times | None = None) -> Line:
        """Tell of a command."""
        return cls(figure, done.cpu, done.seconds, done.peak_mb, done.private_mb, unit)


class Bench:
    """What rows share: sources, bounds, and what was made for rows before.

    Parameters
    ----------
    data, work : Path
        The reference animations, and a folder to work in.
    frames : int, optional
        Most frames of any animation.
    largest : int, optional
        Most points of any mesh.
    names : int
        Recipients to try.
    """

    def __init__(
        self,
        data: Path,
        work: Path,
        *,
        frames: int | None = None,
        largest: int | None = None,
        names: int = 1000,
    ) -> None:
        self.data, self.work, self.names = data, work, names
        self._frames, self._largest = frames, largest
        self._marked: dict[str, Run] = {}
        self.key = Key(bytes(range(32)))
        self.key.save(work / "k")

    def animation(self, name: str, frames: int | None = None) -> MeshAnimation:
        """Read a reference animation, so many frames of it or as many as there may be."""
        mesh = read(self.data / f"{name}.usdc").meshes[0]
        bounds = [n for n in (frames, self._frames) if n is not None]
        return mesh.select(range(min([len(mesh), *bounds])))

    def first_frame(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return points and faces of a first frame."""
        frame = self.animation(name, 1)[0]
        return frame.points, frame.faces

    def run(self, *command: object, codes: tuple[int, ...] = (0,)) -> Run:
        """Run `meshmark`; an exit code beside those expected ends the benchmark."""
        done = run(*command, cwd=self.work)
        if done.code not in codes:
            raise SystemExit(f"meshmark {' '.join(map(str, command))} ended with {done.code}")
        return done

    def cut(self, name: str, frames: int | None = None) -> Path:
        """Write the first frames of a reference animation."""
        animation, whole = self.animation(name, frames), read(self.data / f"{name}.usdc").meshes[0]
        if len(animation) == len(whole):
            return self.data / f"{name}.usdc"
        path = self.work / f"{name}-{len(animation)}.usdc"
        share = len(animation) / len(whole)
        window = ("-p", f"share={share}", "-p", "start=0")
        self.run("attack", "window", self.data / f"{name}.usdc", "-o", path, *window)
        return path

    def marked(self, name: str) -> tuple[Path, Run]:
        """Mark a reference animation once."""
        path = self.work / f"marked-{name}.usdc"
        if name not in self._marked:
            self._marked[name] = self.run("embed", self.cut(name), "-o", path, "--key", "k")
        return path, self._marked[name]

    def allows(self, points: int) -> bool:
        """Whether a mesh is not larger than asked for."""
        return self._largest is None or points <= self._largest

    @cached_property
    def cgal(self) -> CGAL | None:
        """CGAL's side; None where it is missing."""
        try:
            return CGAL(self.work)
        except MissingError as reason:
            print(f"nothing is measured against CGAL: {reason}", file=sys.stderr)
            return None

    def unit(self) -> Times | None:
        """Time `sdf_values` on the elephant's first frame, now, as the machine is now."""
        return self.cgal and self.cgal.sdf_values(*self.first_frame("elephant-gallop"))
