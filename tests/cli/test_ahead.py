"""What is read before the command line is understood is what it will be asked for."""

from __future__ import annotations

import subprocess
import sys

import pytest
import typer

from meshmark.cli.ahead import READINGS, source_of
from meshmark.cli.app import app


@pytest.mark.parametrize("command", READINGS)
def test_it_knows_the_options_of_a_command(command) -> None:
    known = typer.main.get_command(app).commands[command].params
    takes_value = {name: not option.is_flag for option in known[1:] for name in option.opts}
    reading = READINGS[command]
    assert {name for name in reading.switches if not takes_value[name]} == {*reading.switches}
    assert {name for name in reading.valued if takes_value[name]} == {*reading.valued}


@pytest.mark.parametrize(
    ("words", "is_plain"),
    [
        ("verify a --key k", True),
        ("verify --key k --set x=b --json a", True),
        ("verify --key=k a", True),
        ("verify --key a", False),
        ("verify a b --key k", False),
        ("verify a --key k --trusted", False),
        ("verify a --key k --clip run", False),
        ("verify missing --key k", False),
        ("verify @a --key k", False),
        ("embed a -o b --key k --check-all", True),
        ("embed -o a --key k", False),
        ("embed a -ob --key k", False),
        ("embed a -o b --key k --prim /m", False),
        ("inspect a", False),
        ("verify", False),
        ("", False),
    ],
)
def test_one_file_is_read_as_it_is(tmp_path, monkeypatch, words, is_plain) -> None:
    for name in ("a", "b", "@a"):
        (tmp_path / name).touch()
    monkeypatch.chdir(tmp_path)
    assert source_of(words.split()) == ("a" if is_plain else None)


def test_what_scipy_does_not_need_is_not_imported() -> None:
    program = (
        "import sys; from meshmark.commands.importing import put_off;"
        "put_off('numpy.f2py'); import scipy.sparse; before = 'numpy.f2py.rules' in sys.modules;"
        "import numpy; numpy.f2py.get_include(); print(before, 'numpy.f2py.rules' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.stdout.split(), done.stderr) == (["False", "True"], "")
