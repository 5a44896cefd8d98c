"""What a command may do with an input, whatever is in it."""

from __future__ import annotations

import re

from .inputs import Input
from .running import Ran

ALLOWED = (0, 1, 2, 3, 4)
MOST_MEMORY = 2 << 30  # bytes
# What numpy, pxr and Python say unasked.
NOISE = re.compile(r"Traceback|\w*Warning: |Warning: in |Error in |Coding Error|Fatal |\.py:\d+")


def faults(given: Input, ran: Ran) -> list[str]:
    """Name what is wrong; empty where all is well."""
    found = []
    if ran.code not in ALLOWED:
        found.append(f"exit {ran.code}")
    text = ran.out + ran.err
    if "Traceback" in text:
        found.append("traceback")
    elif NOISE.search(ran.err):
        found.append("noise")
    errors = [line for line in ran.err.splitlines() if line.startswith("error: ")]
    # What is kept of each source is told of by itself.
    if len(errors) > 1 and ran.arguments[0] != "try":
        found.append("more than one error")
    if ran.code == 3 and not errors:
        found.append("no error line")
    if ran.peak > MOST_MEMORY:
        found.append("memory")
    if ran.tells_key:
        found.append("key told")
    if ran.stray:
        found.append("stray files")
    return found
