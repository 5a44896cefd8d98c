"""The one place where open3d is imported: lazily, and with an error a person can act on."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

from meshmark.errors import PluginError
from meshmark.system_libraries import missing_libraries, packages_of

# Plots in a browser. open3d imports them, a web server and IPython whenever it is imported, which
# takes as long as all the rest of it.
PLOTS = "open3d.visualization.draw_plotly"


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
        with _plots_put_off():
            return importlib.import_module("open3d")
    except (ImportError, OSError) as error:
        raise PluginError(_advice(error)) from error


@contextmanager
def _plots_put_off() -> Iterator[None]:
    """Let imports meanwhile find functions that import `PLOTS` when they are called, if ever."""
    finder = _PlotsPutOff()
    sys.meta_path.insert(0, finder)
    try:
        yield
    finally:
        sys.meta_path.remove(finder)


class _PlotsPutOff(MetaPathFinder, Loader):
    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        return ModuleSpec(fullname, self) if fullname == PLOTS else None

    def exec_module(self, module: ModuleType) -> None:
        vars(module)["__getattr__"] = _put_off


def _put_off(name: str) -> Callable[..., Any]:
    if name.startswith("__"):
        raise AttributeError(name)

    def call(*args: Any, **kwargs: Any) -> Any:
        return getattr(_plots(), name)(*args, **kwargs)

    return call


@cache
def _plots() -> ModuleType:
    sys.modules.pop(PLOTS, None)
    return importlib.import_module(PLOTS)


def _advice(error: Exception) -> str:
    lacking = missing_libraries()
    if lacking and not isinstance(error, ModuleNotFoundError):
        return (
            f"open3d needs {', '.join(lacking)}, which this system lacks; "
            f"on Debian or Ubuntu: apt-get install {' '.join(packages_of(lacking))}"
        )
    reason = (str(error).splitlines() or [type(error).__name__])[0]
    return f"open3d cannot be imported ({reason}); install meshmark together with its dependencies"
