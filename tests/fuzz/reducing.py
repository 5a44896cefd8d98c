"""Makes a failing input small: pieces of the altered file are left out while it still fails."""

from __future__ import annotations

import re

from .campaign import Campaign, Outcome
from .inputs import Input

TRIES = 60


def reduced(campaign: Campaign, given: Input, outcome: Outcome) -> tuple[Input, Outcome]:
    """Return a smaller input with the same faults, and what comes of it."""
    if "hang" in outcome.faults:
        return given, outcome
    # What fails fast as well is made small fast.
    quick = campaign.alone(given, fast=True)
    fast = quick.faults == outcome.faults
    content = given.files[given.altered]
    is_text = given.kind in ("usda", "obj", "names", "key", "manifest")
    parts = (
        re.split(rb"(?<=\n)", content)
        if is_text
        else [content[i : i + 1] for i in range(len(content))]
    )
    tries, size = TRIES, len(parts) // 2
    while size and tries > 0:
        at = 0
        while at < len(parts) and tries > 0:
            fewer = parts[:at] + parts[at + size :]
            small = given.with_content(b"".join(fewer))
            found = campaign.alone(small, fast)
            tries -= 1
            if found.faults == outcome.faults:
                parts, given, outcome = fewer, small, found
            else:
                at += size
        size //= 2
    return given, outcome
