"""A hook of ShotGrid's publisher, tk-multi-publish2: files are marked, then published.

It goes on top of the hook that publishes files, so that this one gets marked files only:

    hook: "{self}/publish_file.py:{config}/tk-multi-publish2/for_shotgrid.py"

A collector may set two properties of an item: `meshmark_recipient`, whose copy it will be, and
`meshmark_waiver`, who allows, and why, that what can hold no mark is published unmarked. What
became of the file is in the property `meshmark` then.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import sgtk

from meshmark.errors import CapacityError, InputError
from meshmark_plugins.publish.marking import holds_meshes, mark, require_capacity
from meshmark_plugins.publish.recording import Recorder

KEY_FILE, RECIPIENT = "Meshmark Key File", "Meshmark Recipient"
SCHEMES, LEDGER = "Meshmark Schemes", "Meshmark Ledger"
CERTIFICATES, SIGNING_KEY = "Meshmark C2PA Certificates", "Meshmark C2PA Key"
TEXTS = {
    KEY_FILE: "The studio's key file.",
    RECIPIENT: "Whose copies these are, where an item does not say.",
    LEDGER: "Where marks, and waived ones, are recorded; nowhere if empty.",
    CERTIFICATES: "Who signs marked files (PEM); nobody if empty.",
    SIGNING_KEY: "The private key of the first certificate (PEM).",
}

HookBaseClass = sgtk.get_hook_baseclass()


class MarkMeshes(HookBaseClass):  # type: ignore[misc, valid-type]
    """Publish the marked file in place of the one that was collected."""

    @property
    def description(self) -> str:
        """What artists read about it."""
        return f"{super().description}\n\nMeshes are marked before the file is published."

    @property
    def settings(self) -> dict[str, Any]:
        """What is configured: the settings of the hook below, and ours."""
        texts = {
            name: {"type": "string", "default": "", "description": description}
            for name, description in TEXTS.items()
        }
        schemes = {
            "type": "list",
            "values": {"type": "string"},
            "default": [],
            "description": "The layers of a mark; the default ones where empty.",
        }
        return {**(super().settings or {}), **texts, SCHEMES: schemes}

    def validate(self, settings: dict[str, Any], item: Any) -> bool:
        """Validate as the hook below does, and foresee the mark."""
        if not super().validate(settings, item):
            return False
        path = item.properties["path"]
        try:
            if holds_meshes(path):
                require_capacity(path, _options(settings))
        except (CapacityError, InputError) as error:
            if not item.properties.get("meshmark_waiver"):
                self.logger.error("%s", error)
                return False
            self.logger.warning("waived: %s", error)
        return True

    def publish(self, settings: dict[str, Any], item: Any) -> None:
        """Mark the file, then let the hook below publish that; an error ends the publish."""
        path = Path(item.properties["path"])
        if not holds_meshes(path):
            super().publish(settings, item)
            return
        recipient = item.properties.get("meshmark_recipient") or settings[RECIPIENT].value
        place = item.properties.get("publish_path")
        published = mark(
            path,
            path.with_stem(f"{path.stem}.marked"),
            settings[KEY_FILE].value,
            recipient=recipient or None,
            waiver=item.properties.get("meshmark_waiver"),
            options=_options(settings),
            recorder=Recorder.of(settings[LEDGER].value, None, None),
            published=Path(place) if place else None,
        )
        item.properties["meshmark"] = published.told
        item.properties["path"] = str(published.path)
        try:
            super().publish(settings, item)
        finally:
            # What comes last, as saving the next version, is about the collected file.
            item.properties["path"] = str(path)


def _options(settings: dict[str, Any]) -> dict[str, Any]:
    """Tell `marking.mark` what is configured."""
    options: dict[str, Any] = {"schemes": settings[SCHEMES].value}
    if settings[CERTIFICATES].value:
        signs = {"certificates": settings[CERTIFICATES].value, "key": settings[SIGNING_KEY].value}
        options["c2pa"] = signs
    return options
