"""Shared libraries open3d's Linux wheels link to but do not bring, and a bare system may lack.

Needs nothing but Python, so that `bootstrap` can ask before anything is installed.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Mapping

# What the dynamic linker asks for, and the Debian or Ubuntu package that has it.
LIBRARY_PACKAGES: Mapping[str, str] = {
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libX11.so.6": "libx11-6",
    "libgomp.so.1": "libgomp1",
    "libidn2.so.0": "libidn2-0",
    "libudev.so.1": "libudev1",
    "libusb-1.0.so.0": "libusb-1.0-0",
}


def missing_libraries() -> list[str]:
    """Name the shared libraries that the dynamic linker does not find; none outside Linux."""
    if sys.platform != "linux":
        return []
    return [name for name in LIBRARY_PACKAGES if not _loads(name)]


def packages_of(libraries: list[str]) -> list[str]:
    """Name the Debian packages that hold `libraries`, sorted."""
    return sorted(LIBRARY_PACKAGES[name] for name in libraries)


def _loads(name: str) -> bool:
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True


if __name__ == "__main__":
    print(*packages_of(missing_libraries()))
