"""Computations that break down, as on meshes of slivers: the mesh cannot hold a mark."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from meshmark.errors import CapacityError


@contextmanager
def breakdown_means_no_capacity() -> Iterator[None]:
    """Turn a numerical breakdown in a scheme, segmenter or solver into what it says of the mesh.

    Of numbers that leave the range of floating point on the way nothing is printed.

    Raises
    ------
    CapacityError
        If a system of equations has no solution, or an iteration does not converge. Errors of
        any other kind pass.
    """
    try:
        with np.errstate(all="ignore"):
            yield
    except np.linalg.LinAlgError as error:
        raise _no_capacity(error) from error
    except RuntimeError as error:
        # All that SuperLU says of a singular matrix.
        if "singular" not in str(error):
            raise
        raise _no_capacity(error) from error


def _no_capacity(error: Exception) -> CapacityError:
    return CapacityError(f"the surface is too degenerate to compute on ({error})")
