"""The options a command was given, as words that mean the same wherever they are typed."""

from __future__ import annotations

from collections.abc import Collection
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
    for parameter in context.command.params:
        name = parameter.name or ""
        source = context.get_parameter_source(name)
        is_option = parameter.param_type_name == "option"
        if not is_option or name in without or source is None or source.name != "COMMANDLINE":
            continue
        value = context.params[name]
        flag = parameter.opts[0]
        if getattr(parameter, "is_flag", False):
            words += [flag] if value else parameter.secondary_opts[:1]
            continue
        for each in value if isinstance(value, list | tuple) else [value]:
            words += [flag, _absolute(each, name in PATHS)]
    return words


def _absolute(value: Any, is_path: bool) -> str:
    text = str(value)
    if is_path or isinstance(value, Path):
        return str(Path(text).absolute())
    is_list = text.startswith("@") and not text.startswith("@@")
    return f"@{Path(text[1:]).absolute()}" if is_list else text
