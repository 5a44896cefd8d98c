"""Imports what measuring takes, and nothing else, while another process reads."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.util import LazyLoader, find_spec, module_from_spec
from threading import Thread

from meshmark.errors import MeshmarkError
from meshmark.extension.recipe import Recipe

# scipy asks numpy for everything it has, and this takes a fifth of the time of importing scipy.
UNUSED = "numpy.f2py"


@contextmanager
def importing(recipes: Sequence[Recipe]) -> Iterator[None]:
    """Import what measuring by some schemes needs during a block that waits for another process.

    Python does not look for garbage meanwhile: hardly anything that is imported ever is.
    """
    collects = gc.isenabled()
    gc.disable()
    thread = Thread(target=_import, args=(recipes,))
    thread.start()
    try:
        yield
    finally:
        thread.join()
        if collects:
            gc.enable()


def _import(recipes: Sequence[Recipe]) -> None:
    put_off(UNUSED)
    import meshmark.detection.verify  # noqa: F401

    for recipe in recipes:
        # What is wrong with one is said where it is used.
        with suppress(MeshmarkError):
            recipe.build()


def put_off(name: str) -> None:
    """Have a module of a package imported when somebody first looks for anything in it."""
    spec = find_spec(name)
    if name in sys.modules or spec is None or spec.loader is None:
        return
    spec.loader = loader = LazyLoader(spec.loader)
    module = sys.modules[name] = module_from_spec(spec)
    loader.exec_module(module)
    package, _, own = name.rpartition(".")
    setattr(sys.modules[package], own, module)
