"""Compiled loops, which do what functions do in numpy, in a tenth of the time."""

from __future__ import annotations

import importlib
import os
import sys
import warnings
from collections.abc import Callable
from functools import cache, wraps
from threading import Lock
from types import ModuleType
from typing import Any, ParamSpec, TypeVar

import numpy as np

P = ParamSpec("P")
R = TypeVar("R")

_importing = Lock()


def compiled(twin: Callable[P, R]) -> Callable[P, R]:
    """Let the loop of the same name, in `loops.py` beside a function's module, do what it does.

    The function itself, written in numpy, says what the loop does. It does so where numba is
    missing, and tests compare the two; it is kept as `__wrapped__`. Arguments are given by
    position: arrays, floats and ints.
    """
    beside = twin.__module__.rpartition(".")[0] + ".loops"

    @wraps(twin)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        loops = load_loops(beside)
        if loops is None:
            return twin(*args, **kwargs)
        return getattr(loops, twin.__name__)(*map(plain, args), **kwargs)

    return call


def compiled_beside_others(twin: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, where numba was imported for something else before.

    What takes milliseconds is not worth the third of a second that takes. So the loop has to return
    what its twin does bit by bit, or results would depend on what ran before.
    """
    by_loop = compiled(twin)

    @wraps(twin)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        return (by_loop if "numba" in sys.modules else twin)(*args, **kwargs)

    return call


def load_loops(name: str) -> ModuleType | None:
    """Import a module of compiled loops; None where numba is missing.

    There are no wheels of it for all machines.
    """
    with _importing:
        return _load_loops(name)


@cache
def _load_loops(name: str) -> ModuleType | None:
    try:
        _import_numba()
    except (ImportError, OSError):
        return None
    return importlib.import_module(name)


def compile_loop(function: Callable[P, R]) -> Callable[P, R]:
    """Have numba compile a function when it is called for the first time.

    What is compiled is kept in files: in `__pycache__`, or in the user's folder of caches. Sums
    keep their order, so that results are the same on all processors.
    """
    njit: Any = importlib.import_module("numba").njit
    options = {"error_model": "numpy", "nogil": True}
    try:
        return njit(cache=True, **options)(function)
    except RuntimeError:
        # No folder can be written to: each process compiles for itself.
        return njit(**options)(function)


def plain(argument: Any) -> Any:
    """Make an array contiguous and writable, of float64, int64 or bool: loops compile only once."""
    if not isinstance(argument, np.ndarray):
        return argument
    kind = {"f": np.float64, "i": np.int64, "u": np.int64, "b": np.bool_}[argument.dtype.kind]
    return np.require(argument, kind, ["C", "W", "A"])


def _import_numba() -> None:
    """Import numba without the settings that it looks for in the working directory.

    They could name a folder of compiled code, which then runs; see docs/environment.md. numba asks
    for them when it is imported, if there is a module `yaml`, and whenever it compiles.
    """
    missing = object()
    yaml: Any = sys.modules.get("yaml", missing)
    sys.modules["yaml"] = None  # type: ignore[assignment]
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="A Numba config file is found")
            config: Any = importlib.import_module("numba.core.config")
    finally:
        if yaml is missing:
            del sys.modules["yaml"]
        else:
            sys.modules["yaml"] = yaml
    config._config_fname = os.devnull
