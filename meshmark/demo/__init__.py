"""A galloping creature made by meshmark's own code: for demonstrations and tests."""

from __future__ import annotations

from meshmark.demo.build import creature, write_creature

__all__ = ["creature", "write_creature"]
