"""The one place where open3d is imported: lazily, and with an error a person can act on."""

from __future__ import annotations

import importlib
from functools import cache
from types import ModuleType

from meshmark.errors import PluginError
from meshmark.system_libraries import missing_libraries, packages_of


@cache
def load_open3d() -> ModuleType:
    """Import open3d and return it.

    Raises
    ------
    PluginError
        If it is not installed, or cannot be loaded because the system lacks a shared library;
        the message names the packages to install.
    """
    try:
        return importlib.import_module("open3d")
    except (ImportError, OSError) as error:
        raise PluginError(_advice(error)) from error


def _advice(error: Exception) -> str:
    lacking = missing_libraries()
    if lacking and not isinstance(error, ModuleNotFoundError):
        return (
            f"open3d needs {', '.join(lacking)}, which this system lacks; "
            f"on Debian or Ubuntu: apt-get install {' '.join(packages_of(lacking))}"
        )
    reason = (str(error).splitlines() or [type(error).__name__])[0]
    return f"open3d cannot be imported ({reason}); install meshmark together with its dependencies"
