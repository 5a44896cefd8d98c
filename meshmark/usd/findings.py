"""What `meshmark check` finds in a file."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, order=True)
class Finding:
    """Something that is wrong with a file.

    Parameters
    ----------
    kind : str
        What it gives away: `copy`, a second copy of a mesh's shape; `layer`, a file it depends
        on; `path`, a path that leads out of its folder; `metadata`, words on its origin.
        What is wrong with its marks: `unmarkable`, a mesh that can hold none; `stale`, a source
        that is not what was marked; `frames`, frames that hold none.
    where : str
        The prim, property or metadata; the path of a file for `layer`, `path` and `stale`.
    what : str
        In words.
    """

    kind: str
    where: str
    what: str
