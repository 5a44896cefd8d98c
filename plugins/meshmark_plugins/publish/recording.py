"""What a publish records in the studio's ledger, if it keeps one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meshmark.embedding.manifest import output_hashes

if TYPE_CHECKING:
    # It needs packages that not everybody has.
    from meshmark.ledger.store import Ledger


@dataclass(frozen=True)
class Recorder:
    """Records what is published of one version of an asset.

    Parameters
    ----------
    ledger : Ledger or None
        None records nothing.
    asset, version : str or None
        What the ledger calls it; see `meshmark.ledger.marks.mark_of`.
    """

    ledger: Ledger | None
    asset: str | None
    version: str | None

    @classmethod
    def of(cls, where: str | None, asset: str | None, version: str | None) -> Recorder:
        """Open a ledger to write to, if there is to be one.

        Raises
        ------
        UsageError, InputError, OutputError
            If it cannot be written to.
        """
        if not where:
            return cls(None, asset, version)
        from meshmark.ledger.extra import require_installed

        require_installed()
        from meshmark.ledger.store import Ledger

        ledger = Ledger(where)
        ledger.require_writable()
        return cls(ledger, asset, version)

    def mark(self, manifest: dict[str, Any], output: Path, published: Path | None) -> None:
        """Record a marked copy, and where it goes if that is known."""
        if self.ledger is not None:
            from meshmark.ledger.marks import mark_of

            content = mark_of(
                manifest, output, asset=self.asset, version=self.version, published=published
            )
            self.ledger.append(content)

    def waiver(self, source: Path, waiver: str, reason: str, recipient: str | None) -> None:
        """Record what goes out unmarked."""
        if self.ledger is not None:
            from meshmark.ledger.marks import waiver_of

            content = waiver_of(
                source,
                output_hashes(source),
                waiver=waiver,
                reason=reason,
                recipient=recipient,
                asset=self.asset,
                version=self.version,
            )
            self.ledger.append(content)


def place_of(representation: Mapping[str, Any], data: Mapping[str, Any]) -> str | None:
    """Tell where a representation of a pyblish instance will be, as far as that is known by now.

    AYON names a file only when it integrates it. What it knows before is the folder.
    """
    return representation.get("published_path") or data.get("publishDir")
