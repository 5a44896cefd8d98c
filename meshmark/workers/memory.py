"""Memory that was freed, given back to the system."""

from __future__ import annotations

import ctypes


def give_back_memory() -> None:
    """Give memory that was freed back to the system, where the C library waits to be told.

    glibc keeps whatever lies below something that is still used. Other libraries do without.
    """
    try:
        trim = ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError, TypeError):
        return
    trim(0)
