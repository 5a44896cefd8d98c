"""Numbers as JSON can hold them."""

from __future__ import annotations

import math


def number(x: float) -> float | None:
    """Return a plain float, or None for what JSON has no word for: not a number, infinite."""
    return float(x) if math.isfinite(x) else None
