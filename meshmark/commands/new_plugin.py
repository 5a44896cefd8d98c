"""Starts the distribution of a plugin: whole, tested, and there for its author to change."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from string import Template

from meshmark.errors import OutputError, UsageError
from meshmark.extension.registry import catalogue
from meshmark.files.atomic import beside
from meshmark.version import __version__

NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
# Characters of a name. Lines of the files that have it in them would be too long otherwise.
LONGEST = 24


@dataclass(frozen=True)
class Kind:
    """What is written for a kind of plugin.

    Parameters
    ----------
    summary : str
        What the example does.
    article : str
        What stands before the kind's name.
    registered : str
        The kind's name in the registry, where it is another.
    """

    summary: str
    article: str = "A"
    registered: str = ""


KINDS = {
    "segmenter": Kind("slabs across the longest axis"),
    "solver": Kind("shortest paths along edges", registered="geodesic"),
    "reader": Kind("OFF files"),
    "scheme": Kind("bits in shells about the centre"),
    "attack": Kind("sheared in a direction drawn by chance", "An"),
}


def new_plugin(name: str, kind: str, folder: Path | None = None) -> Path:
    """Write a distribution with one plugin, which works, and its tests.

    Parameters
    ----------
    name : str
        What users will type: lower-case letters, digits and dashes, a letter first.
    kind : str
        One of `KINDS`.
    folder : Path, optional
        Where to, which must not be there yet; by default, `meshmark-NAME` in the working directory.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    UsageError
        If the name is none, or taken, or there is no such kind.
    OutputError
        If the folder is there, or cannot be written; nothing is left of it then.
    """
    if kind not in KINDS:
        raise UsageError(f"no kind of plugin is called {kind!r}; there are: {', '.join(KINDS)}")
    if not NAME.fullmatch(name) or len(name) > LONGEST:
        raise UsageError(
            f"{name!r} is no name for a plugin: lower-case letters, digits and dashes, a letter "
            f"first, {LONGEST} at most"
        )
    _require_free(name, kind)
    place = Path(f"meshmark-{name}") if folder is None else folder
    if place.exists() or place.is_symlink():
        raise OutputError("is there already", source=place)
    with beside(place) as made:
        for path, text in rendered(name, kind).items():
            (made / path).parent.mkdir(parents=True, exist_ok=True)
            (made / path).write_text(text, encoding="utf-8", newline="\n")
        made.rename(place)
    return place


def rendered(name: str, kind: str) -> dict[str, str]:
    """Return the files of a distribution, by their paths in it."""
    module, about = _module(name), KINDS[kind]
    parts = name.split("-")
    words = {
        "name": name,
        "kind": kind,
        "module": module,
        "distribution": f"meshmark-{name}",
        "Class": "".join(map(str.capitalize, parts if parts[-1] == kind else [*parts, kind])),
        "summary": about.summary,
        "article": about.article,
        "meshmark": __version__,
    }
    templates = {
        "pyproject.toml": "pyproject.toml.txt",
        "README.md": "README.md.txt",
        f"src/{module}/__init__.py": f"{kind}/record.py.txt",
        f"src/{module}/{kind}.py": f"{kind}/implementation.py.txt",
        f"src/{module}/py.typed": "",
        f"tests/test_{module}.py": f"{kind}/test.py.txt",
    }
    return {path: _filled(template, words) for path, template in templates.items()}


def _filled(template: str, words: dict[str, str]) -> str:
    if not template:
        return ""
    place = files("meshmark.commands") / "plugin_templates" / template
    return Template(place.read_text(encoding="utf-8")).substitute(words)


def _module(name: str) -> str:
    return f"meshmark_{name.replace('-', '_')}"


def _require_free(name: str, kind: str) -> None:
    registered = KINDS[kind].registered or kind
    for offer in catalogue().offers:
        if (offer.kind, offer.name) == (registered, name):
            raise UsageError(f"{kind} {name!r} is offered by {offer.distribution} already")
    if find_spec(_module(name)) is not None:
        raise UsageError(f"there is a module {_module(name)} already; choose another name")
