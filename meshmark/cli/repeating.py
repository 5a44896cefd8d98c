"""What was typed, as words that can be typed again: anywhere, or as they stood."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import typer

# Options that name a file by text.
PATHS = {"key", "original", "master"}


def given_options(context: typer.Context, without: Collection[str]) -> list[str]:
    """Return the options of a command line, paths made absolute.

    Parameters
    ----------
    without : collection of str
        Names of parameters to leave out.
    """
    words: list[str] = []
    for parameter, name, value in _given(context):
        if parameter.param_type_name == "option" and name not in without:
            is_path = name in PATHS
            words += _words(parameter, value, lambda each, path=is_path: _absolute(each, path))
    return words


def typed_command(context: typer.Context, instead: Mapping[str, str]) -> str:
    """Return a command line as it was typed, in the order of the parameters, for a shell.

    Parameters
    ----------
    instead : mapping of str to str
        What stands for the values of parameters that must not be told, such as keys.
    """
    words = ["meshmark", context.info_name or ""]
    for parameter, name, value in _given(context):
        words += _words(parameter, instead.get(name, value), str)
    return shlex.join(words)


def _given(context: typer.Context) -> Iterator[tuple[Any, str, Any]]:
    """List the parameters that were typed, with name and value."""
    for parameter in context.command.params:
        name = parameter.name or ""
        source = context.get_parameter_source(name)
        if source is not None and source.name == "COMMANDLINE":
            yield parameter, name, context.params[name]


def _words(parameter: Any, value: Any, told: Callable[..., str]) -> list[str]:
    values = value if isinstance(value, list | tuple) else [value]
    if parameter.param_type_name == "argument":
        return [told(each) for each in values]
    flag = parameter.opts[0]
    if getattr(parameter, "is_flag", False):
        return [flag] if value else parameter.secondary_opts[:1]
    return [word for each in values for word in (flag, told(each))]


def _absolute(value: Any, is_path: bool) -> str:
    text = str(value)
    if is_path or isinstance(value, Path):
        return str(Path(text).absolute())
    is_list = text.startswith("@") and not text.startswith("@@")
    return f"@{Path(text[1:]).absolute()}" if is_list else text
