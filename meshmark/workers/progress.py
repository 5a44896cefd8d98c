"""Types of the functions by which long work says how far it is."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

# Frames done, frames in all.
FrameProgress: TypeAlias = Callable[[int, int], None]
# Prim, frames done, frames in all.
MeshProgress: TypeAlias = Callable[[str, int, int], None]
# Stage of the work, prim, frames done, frames in all.
StageProgress: TypeAlias = Callable[[str, str, int, int], None]
