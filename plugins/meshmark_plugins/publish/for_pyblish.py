"""Plugins of pyblish, and so of AYON and OpenPype: nothing unmarked gets to the integrator.

Register both, or put a copy of this file into a folder of pyblish plugins. An instance may have

- `meshmark_recipient`: whose copy it will be;
- `meshmark_waiver`: who allows, and why, that what can hold no mark is published unmarked;
- `meshmark_asset`, `meshmark_version`: what the ledger calls it.

What became of its files is then in `meshmark`: for each, what `marking.Published` tells.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import pyblish.api

from meshmark.errors import CapacityError, InputError
from meshmark_plugins.publish.marking import BESIDE, Published, holds_meshes, mark, require_capacity
from meshmark_plugins.publish.recording import Recorder, place_of

# Where integrators look for what they are to publish.
PUBLISHED = ("representations", "representations_with_traits", "transfers", "hardlinks")
NAMED = ("meshmark_asset", "meshmark_version")
FAMILIES = ["animation", "model", "pointcache", "usd"]


class ValidateCapacity(pyblish.api.InstancePlugin):  # type: ignore[misc]
    """Stop at once if a file that is there by now can hold no mark."""

    label = "Can hold a mark"
    order = pyblish.api.ValidatorOrder
    families = FAMILIES
    settings_category = "meshmark"
    # What else `meshmark.mark_file` is to be told; see `marking.mark`.
    options: ClassVar[dict[str, Any]] = {}

    def process(self, instance: Any) -> None:
        """Foresee the mark of each file."""
        if not is_published_here(instance):
            return
        data = instance.data
        staged = [path for each in data.get("representations", ()) for path in files_of(each, data)]
        for path in filter(holds_meshes, staged):
            try:
                if path.exists():
                    require_capacity(path, self.options)
            except (CapacityError, InputError) as error:
                if not data.get("meshmark_waiver"):
                    raise
                self.log.warning("waived: %s", error)


class MarkMeshes(pyblish.api.InstancePlugin):  # type: ignore[misc]
    """Mark every file that holds meshes.

    Integrators run even if a plugin before them failed. So all that they would take is taken away
    first, and given back when all of it is marked.
    """

    label = "Mark meshes"
    # After what rewrites paths in layers, at - 0.01: manifests have the hashes of what goes out.
    order = pyblish.api.IntegratorOrder - 0.005
    families = FAMILIES
    settings_category = "meshmark"
    options: ClassVar[dict[str, Any]] = {}
    key_file = ""
    # Whose copies these are, where an instance does not say.
    recipient = ""
    # Where marks, and waived ones, are recorded; see docs/ledger.md.
    ledger = ""
    # Publish manifests, too, each as a representation of its own.
    manifests = True

    def process(self, instance: Any) -> None:
        """Mark what is published from here; on a farm, this plugin runs there."""
        if not is_published_here(instance):
            return
        data, held = instance.data, withhold(instance.data)
        if held.get("representations_with_traits"):
            raise CapacityError("representations with traits cannot be marked", source=instance)
        told: list[dict[str, Any]] = []
        ready: dict[str, list[Any]] = {name: [] for name in held}
        asked = held.get("representations", ())
        # What an earlier attempt added is added anew.
        added = [f"{each.get('name', 'usd')}_{kind}" for each in asked for kind in BESIDE]
        for each in (each for each in asked if each.get("name") not in added):
            ready["representations"] += self._representations(each, data, told)
        for name in ("transfers", "hardlinks"):
            for source, target in held.get(name, ()):
                marks = holds_meshes(source)
                path = self._mark(Path(source), data, told, target).path if marks else source
                ready[name].append((str(path), target))
        data.update(ready, integrate=True, meshmark=told)

    def _representations(
        self, representation: dict[str, Any], data: dict[str, Any], told: list[dict[str, Any]]
    ) -> list[dict[str, Any]]:
        """Return a representation of the marked file, and of what goes with it."""
        paths = files_of(representation, data)
        if not any(map(holds_meshes, paths)):
            return [representation]
        if len(paths) > 1:
            raise CapacityError(f"is one of {len(paths)} files: publish one", source=paths[0])
        published = self._mark(paths[0], data, told, place_of(representation, data))
        name, many = published.path.name, not isinstance(representation["files"], str)
        ready = [{**representation, "files": [name] if many else name}]
        for kind, path in published.beside.items():
            if kind != "meshmark" or self.manifests:
                beside = {"name": f"{representation.get('name', 'usd')}_{kind}", "files": path.name}
                ready.append(beside | {"ext": path.suffix[1:], "stagingDir": str(path.parent)})
        return ready

    def _mark(
        self, path: Path, data: dict[str, Any], told: list[dict[str, Any]], place: str | None
    ) -> Published:
        published = mark(
            path,
            path.with_stem(f"{path.stem}.marked"),
            self.key_file,
            recipient=data.get("meshmark_recipient") or self.recipient or None,
            waiver=data.get("meshmark_waiver"),
            options=self.options,
            recorder=Recorder.of(self.ledger, *map(data.get, NAMED)),
            published=Path(place) if place else None,
        )
        self.log.info("%s", published.told)
        told.append(published.told)
        return published


def is_published_here(instance: Any) -> bool:
    """Tell whether an instance is published, and not later on a farm."""
    return not instance.data.get("farm") and instance.data.get("integrate", True) is not False


def withhold(data: dict[str, Any]) -> dict[str, Any]:
    """Take away what integrators would publish, and return it."""
    held = {name: data[name] for name in PUBLISHED if name in data}
    data.update({name: [] for name in held}, integrate=False)
    return held


def files_of(representation: dict[str, Any], data: dict[str, Any]) -> list[Path]:
    """List the files of a representation."""
    folder = Path(representation.get("stagingDir") or data.get("stagingDir") or ".")
    names = representation["files"]
    return [folder / name for name in ([names] if isinstance(names, str) else names)]
