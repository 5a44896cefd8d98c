"""What USD itself can learn of meshmark: the schema of stamps, and validators."""

from __future__ import annotations

from pathlib import Path


def register() -> None:
    """Let USD, in this process, know the schema in this folder and `meshmark.validation`.

    USD looks at its schemas once, when it first needs one: call this before a stage is opened. To
    call it again does nothing.
    """
    from pxr import Plug

    Plug.Registry().RegisterPlugins(str(Path(__file__).parent))
