"""What `meshmark check` looks for, as validators of usd-core.

usd-core imports this module when a validator of the plugin `meshmark.validation` is first wanted;
`meshmark.usd.plugin.register` lets it know the plugin.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from pxr import Sdf, Usd, UsdValidation

from meshmark.commands.check import given_away, stale_in, unmarkable_in, unmarked_frames_in
from meshmark.embedding.upkeep import told_of
from meshmark.usd.findings import Finding

# How errors are called, by the kind of finding.
NAMES = {
    "copy": "UnmarkedCopy",
    "layer": "DependsOnLayer",
    "path": "PathOutside",
    "metadata": "TellsOfOrigin",
    "unmarkable": "Unmarkable",
    "stale": "Stale",
    "frames": "UnmarkedFrames",
}
FAILED, NO_FILE = "Failed", "NoFile"

Look = Callable[[str], Iterable[Finding]]


def given_away_if_delivered(file: str) -> list[Finding]:
    """List what a deliverable gives away; nothing of files that may give all away."""
    return given_away(file) if told_of(Path(file)).delivered else []


VALIDATORS: dict[str, Look] = {
    "UnmarkableMesh": unmarkable_in,
    "StaleOverride": stale_in,
    "UnmarkedPoints": given_away_if_delivered,
    "UnmarkedFrames": unmarked_frames_in,
}


def task(look: Look) -> Callable[[Usd.Stage, object], list[UsdValidation.ValidationError]]:
    """Return what usd-core calls: it looks at the stage's file, and never raises.

    An exception would end the whole run, and lose what other validators found.
    """

    def validate(stage: Usd.Stage, _: object) -> list[UsdValidation.ValidationError]:
        try:
            file = stage.GetRootLayer().realPath
            if not file:
                return [_error(stage, NO_FILE, "/", "the stage lies in no file: not looked at")]
            return [
                _error(stage, NAMES[each.kind], each.where, f"{each.where}: {each.what}")
                for each in look(file)
            ]
        except Exception as error:
            return [_error(stage, FAILED, "/", f"{type(error).__name__}: {error}")]

    return validate


def _error(stage: Usd.Stage, name: str, where: str, what: str) -> UsdValidation.ValidationError:
    path = Sdf.Path.absoluteRootPath
    if Sdf.Path.IsValidPathString(where) and stage.GetObjectAtPath(where):
        path = Sdf.Path(where)
    kinds = UsdValidation.ValidationErrorType
    kind = kinds.Warn if name in (NO_FILE, NAMES["unmarkable"]) else kinds.Error
    return UsdValidation.ValidationError(
        name, kind, [UsdValidation.ValidationErrorSite(stage, path)], what
    )


if not hasattr(UsdValidation.ValidationRegistry, "RegisterPluginStageValidator"):
    raise ImportError("validators in Python need usd-core 26.5 or later")
for _name, _look in VALIDATORS.items():
    UsdValidation.ValidationRegistry().RegisterPluginStageValidator(
        f"{__name__}:{_name}", task(_look)
    )
