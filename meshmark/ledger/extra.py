"""What the ledger needs is installed on demand."""

from __future__ import annotations

from importlib.util import find_spec

from meshmark.errors import UsageError

ADVICE = "pip install 'meshmark[ledger]'"


def require_installed(*modules: str) -> None:
    """Refuse to go on without the packages that every ledger needs, and others.

    Raises
    ------
    UsageError
        If one is not installed.
    """
    for module in ("sqlalchemy", "alembic", *modules):
        if find_spec(module) is None:
            raise UsageError(f"the ledger needs {module}, which is not installed: {ADVICE}")
