"""What `verify` tries where nobody says, and what it tells of its looks."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from command_line import command
from meshmark.commands.attack import write_attacked
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import as_asset
from meshmark.testing.meshes import icosphere
from meshmark.testing.schemas import schema_folder

KEY = ("--key", "k")


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run the command line in a folder with a key, and a ball that swells and shrinks."""
    V, F = icosphere(3)
    sizes = 1.0 + 0.1 * np.sin(np.arange(6.0))
    ball = MeshAnimation.from_arrays([V * size for size in sizes], F, prim="/Ball")
    write_attacked(as_asset(ball), tmp_path / "ball.usdc")
    Key(bytes(range(32))).save(tmp_path / "k")
    monkeypatch.chdir(tmp_path)

    def call(*arguments: object) -> tuple[int, dict, str]:
        code = command(monkeypatch, "verify", *arguments, *KEY, "--json", "--trusted")
        captured = capsys.readouterr()
        document = json.loads(captured.out)
        schema = json.loads((schema_folder("json") / "verdict.schema.json").read_text("utf-8"))
        jsonschema.validate(document, schema)
        return code, document["assets"][0], captured.err

    return call


def test_looks_are_told_and_why_there_are_no_more(run) -> None:
    code, asset, said = run("ball.usdc")
    assert (code, asset["verdict"], asset["ended"]) == (4, "inconclusive", "no hope")
    looks = [(look["schemes"], look["restored"]) for look in asset["looks"]]
    assert looks == [(["apex"], "none"), (["apex"], "all"), (["apex"], "most")]
    assert "apex: 4 of 6 frames give no hope of a mark" in said
    assert "frames : looks at everything" in said
    code, asset, said = run("ball.usdc", "--frames", ":")
    assert (code, asset["ended"], len(asset["looks"])) == (4, "all seen", 1)
    assert "no hope" not in said


def schemes_of(asset: dict) -> set[str]:
    return {scheme for look in asset["looks"] for scheme in look["schemes"]}


def test_a_scheme_that_embed_does_not_use_is_tried_where_the_manifest_names_it(run) -> None:
    manifest = {"layers": [{"name": "cho2007"}, {"name": "unheard of"}]}
    Path("ball.usdc.meshmark.json").write_text(json.dumps(manifest))
    assert schemes_of(run("ball.usdc")[1]) == {"apex", "cho2007"}
    # Whoever asks for schemes gets those.
    assert schemes_of(run("ball.usdc", "--scheme", "apex")[1]) == {"apex"}
