"""Folders that tests look into."""

from __future__ import annotations

from pathlib import Path

TESTS = Path(__file__).resolve().parent
REPOSITORY = TESTS.parent
FAULTS = TESTS / "faults"
