"""What a stamp on a marked mesh says; pxr is needed to read or write one, not here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True)
class Stamp:
    """What a stamp says: nothing of the key, the source and the recipient.

    Parameters
    ----------
    record : str
        Which manifest tells of the mark, 32 hexadecimal digits.
    schemes : tuple of str
        Of the layers that the mesh holds, in order.
    """

    record: str
    schemes: tuple[str, ...]


# Of meshes, by the paths that they were read under.
Stamps = Mapping[str, Stamp]
NO_STAMPS: Stamps = MappingProxyType({})
