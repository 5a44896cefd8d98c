"""An original as an informed scheme sees it, made when it is first asked for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from meshmark.extension.informed import layout_frame
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.topology import Topology
from meshmark.mesh.welding import Welding


@dataclass(frozen=True, eq=False)
class OriginalLayout:
    """Where a scheme's chips lie on an original; pickles without what it made.

    Parameters
    ----------
    original : MeshAnimation
    scheme : InformedScheme
    """

    original: MeshAnimation
    scheme: Any

    def __getstate__(self) -> dict[str, Any]:
        # What is made again where it is needed need not travel.
        return {name: vars(self)[name] for name in ("original", "scheme")}

    @cached_property
    def _seen(self) -> tuple[Welding, Frame]:
        return layout_frame(self.original)

    @property
    def welding(self) -> Welding:
        """What frames are seen through."""
        return self._seen[0]

    @cached_property
    def polygons(self) -> Topology:
        """Polygons of the file, welded."""
        return self.welding.polygons(self.original[0].topology)

    @cached_property
    def layout(self) -> Any:
        """Where chips lie: an `InformedLayout`."""
        return self.scheme.layout(self._seen[1])
