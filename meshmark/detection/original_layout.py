"""An original as an informed scheme sees it, made when it is first asked for."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

from meshmark.extension.informed import layout_frame
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.breakdown import breakdown_means_no_capacity
from meshmark.mesh.topology import Topology
from meshmark.mesh.welding import Welding
from meshmark.workers.beside import Beside


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
    _begun: Beside[Any] | None = field(default=None, init=False, repr=False)

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
        return self._lay_out(self._seen[1]) if self._begun is None else self._begun.result()

    def begin(self) -> None:
        """Lay chips out in a thread, until somebody asks where they lie; see `end`.

        Raises
        ------
        CapacityError
            If no frame has a surface.
        """
        # Files are read in this thread only.
        _, frame = self._seen
        object.__setattr__(self, "_begun", Beside(partial(self._lay_out, frame)))

    def end(self) -> None:
        """End what was begun, if nobody has asked for it."""
        if self._begun is not None:
            self._begun.end()

    def _lay_out(self, frame: Frame) -> Any:
        with breakdown_means_no_capacity():
            return self.scheme.layout(frame)
