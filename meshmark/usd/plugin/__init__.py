"""What USD itself can learn of meshmark: the schema of stamps, without code."""

from __future__ import annotations

from pathlib import Path


def register() -> None:
    """Let USD, in this process, know the plugin in this folder; to call it again does nothing.

    USD looks at its schemas once, when it first needs one: call this before a stage is opened.
    """
    from pxr import Plug

    Plug.Registry().RegisterPlugins(str(Path(__file__).parent))
