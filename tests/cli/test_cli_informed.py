"""Layers and originals on the command line: what is written, what is printed, which exit code."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest

from command_line import command
from meshmark.commands.attack import write_attacked
from meshmark.demo import creature
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import as_asset
from meshmark.testing.informed_schemes import horned
from meshmark.testing.meshes import bent_tube, icosphere
from meshmark.testing.schemas import schema_folder

MARK = ("--key", "k", "--recipient", "acme")


@pytest.fixture(scope="module")
def studio(tmp_path_factory) -> Path:
    """Return a folder with a creature, a ball and a tube, and a copy of the creature."""
    folder = tmp_path_factory.mktemp("studio")
    Key(bytes(range(32))).save(folder / "k")
    V, F = bent_tube(24, 40)
    assets = {
        "creature.usdc": as_asset(creature(points=3000, frames=1)),
        "horns.usdc": as_asset(horned()),
        "ball.usdc": as_asset(MeshAnimation.from_arrays(*icosphere(3), prim="/Horns")),
        "tube.usdc": as_asset(MeshAnimation.from_arrays(V, F, prim="/Tube")),
    }
    for name, asset in assets.items():
        write_attacked(asset, folder / name)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        keep = ("--master", "master.usdc")
        assert command(patch, "embed", "creature.usdc", "-o", "acme.usdc", *MARK, *keep) == 0
        relief = ("--scheme", "relief")
        assert command(patch, "embed", "horns.usdc", "-o", "horns-acme.usdc", *MARK, *relief) == 0
    return folder


@pytest.fixture
def run(studio, monkeypatch, capsys):
    """Run the command line in the studio's folder."""
    monkeypatch.chdir(studio)

    def call(*arguments: object) -> tuple[int, str, str]:
        code = command(monkeypatch, *arguments)
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


def validated(document, name: str):
    schema = json.loads((schema_folder("json") / f"{name}.schema.json").read_text())
    jsonschema.validate(document, schema)
    return document


def manifest(path: Path):
    return validated(json.loads(Path(f"{path}.meshmark.json").read_text()), "manifest")


def refused(outcome, code: int, *words: str) -> None:
    """Fail unless it ended with a code and one line that has these words."""
    got, out, err = outcome
    assert got == code, err
    lines = [line for line in (out + err).splitlines() if line.strip()]
    assert len(lines) == 1, lines
    assert all(word in lines[0] for word in words), lines[0]


def test_the_manifest_tells_of_every_layer(studio) -> None:
    document = manifest(studio / "acme.usdc")
    assert [layer["name"] for layer in document["layers"]] == ["apex", "relief"]
    assert document["recipient"] == "acme"
    [prim] = document["prims"]
    assert [layer["scheme"] for layer in prim["layers"]] == ["apex", "relief"]
    assert prim["carriers"] == sum(layer["carriers"] for layer in prim["layers"])
    assert prim["missing"] == []
    assert prim["distortion"]["mrms_rel"] <= 2.2e-4
    assert document["verification"]["verdict"] == "marked"


def test_what_cannot_hold_a_layer_is_told(run, studio) -> None:
    code, _, err = run("embed", "ball.usdc", "-o", "ball-acme.usdc", *MARK)
    assert code == 0
    assert "no mark by apex" in err
    [prim] = manifest(studio / "ball-acme.usdc")["prims"]
    assert [layer["scheme"] for layer in prim["layers"]] == ["relief"]
    [missing] = prim["missing"]
    assert missing["scheme"] == "apex"
    assert missing["reason"]


@pytest.mark.slow
def test_the_limit_of_the_command_line_is_for_all_layers(run, studio) -> None:
    limit = ("--max-mrms", "1e-4")
    assert run("embed", "creature.usdc", "-o", "low.usdc", *MARK, *limit)[0] == 0
    [prim] = manifest(studio / "low.usdc")["prims"]
    assert 0.5e-4 < prim["distortion"]["mrms_rel"] <= 1e-4


def test_verify_names_the_recipient_beside_original_and_master(run) -> None:
    beside = ("--original", "creature.usdc", "--master", "master.usdc")
    names = ("--recipient", "acme", "--recipient", "bob")
    code, out, _ = run("verify", "acme.usdc", "--key", "k", *beside, *names, "--json")
    assert code == 0
    document = validated(json.loads(out), "verdict")
    [asset] = document["assets"]
    assert (asset["verdict"], asset["recipient"]) == ("marked", "acme")
    assert asset["original"] == "creature.usdc"
    [prim] = asset["prims"]
    informed = prim["informed"]
    assert (informed["prim"], informed["method"]) == (prim["prim"], "identity")
    assert informed["covered"] > 0.99
    assert informed["patches"] > 1000
    assert informed["residual"] < 1e-3


def test_verify_says_how_the_copy_lies(run) -> None:
    asked = ("--scheme", "relief", "--recipient", "acme", "--original", "horns.usdc")
    code, out, err = run("verify", "horns-acme.usdc", "--key", "k", *asked)
    assert code == 0
    assert "copy of acme" in out + err
    assert "100 % of it covered" in out + err


def test_alone_the_copy_says_no_more_than_whose_it_was(run) -> None:
    names = ("--recipient", "acme", "--recipient", "bob")
    code, out, _ = run("verify", "acme.usdc", "--key", "k", "--scheme", "apex", *names, "--json")
    assert code == 0
    [asset] = validated(json.loads(out), "verdict")["assets"]
    assert (asset["verdict"], asset["recipient"], asset["recipients"]) == ("marked", None, [None])
    assert "original" not in asset


@pytest.mark.slow
def test_a_master_of_something_else_is_refused_in_one_line(run) -> None:
    verify = ("verify", "horns-acme.usdc", "--key", "k", "--original", "horns.usdc", "--master")
    refused(run(*verify, "ball.usdc"), 2, "ball.usdc", "/Horns", "other frames or faces")
    refused(run(*verify, "tube.usdc"), 2, "tube.usdc", "no mesh of the original")
    refused(run(*verify, "none.usdc"), 3, "none.usdc")


def test_a_master_needs_an_original(run) -> None:
    refused(run("verify", "acme.usdc", "--key", "k", "--master", "master.usdc"), 2, "--original")


def test_no_such_original_is_bad_input(run) -> None:
    refused(run("verify", "acme.usdc", "--key", "k", "--original", "none.usdc"), 3, "none.usdc")


def test_an_informed_scheme_alone_needs_an_original(run) -> None:
    refused(run("verify", "acme.usdc", "--key", "k", "--scheme", "relief"), 2, "relief", "original")


@pytest.mark.slow
def test_the_original_of_another_animal_is_inconclusive(run) -> None:
    # The blind scheme has enough chips to say "not marked", but looks at half of what there is.
    schemes = ("--scheme", "relief", "--scheme", "cho2007")
    asked = ("--key", "k", "--original", "tube.usdc", "--json")
    code, out, _ = run("verify", "horns-acme.usdc", *schemes, *asked)
    assert code == 4
    [asset] = validated(json.loads(out), "verdict")["assets"]
    assert asset["verdict"] == "inconclusive"
    assert asset["original"] == "tube.usdc"
    assert any("/Tube" in note for note in asset["notes"])


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (("--scheme", "relief"), "blind layers"),
        (("--master-is-output",), "the master is the output"),
    ],
    ids=["no blind layer", "the output"],
)
def test_a_master_that_makes_no_sense_is_refused(run, studio, options, word) -> None:
    output = ("-o", "new.usdc", "--master", "m.usdc")
    if options == ("--master-is-output",):
        options, output = (), ("-o", "new.usdc", "--master", "./new.usdc")
    refused(run("embed", "horns.usdc", *output, "--key", "k", *options), 2, word)
    assert not (studio / "new.usdc").exists()
    assert not (studio / "m.usdc").exists()
    assert not (studio / "new.usdc.meshmark.json").exists()


def test_a_scheme_twice_is_refused(run) -> None:
    twice = ("--scheme", "relief", "--scheme", "relief")
    refused(run("embed", "horns.usdc", "-o", "new.usdc", "--key", "k", *twice), 2, "layers")


def test_originals_and_masters_are_read_like_copies_in_a_process_of_their_own(
    run, monkeypatch
) -> None:
    from meshmark.commands import verify as verifying

    seen: dict[str, bool] = {}
    read = verifying.read

    def noticed(source, *, isolated=False, **options):
        seen[str(source)] = isolated
        return read(source, isolated=isolated, **options)

    monkeypatch.setattr(verifying, "read", noticed)
    beside = ("--original", "horns.usdc", "--master", "horns.usdc", "--scheme", "relief")
    run("verify", "horns-acme.usdc", "--key", "k", *beside)
    assert seen == {"horns-acme.usdc": True, "horns.usdc": True}
    run("verify", "horns-acme.usdc", "--key", "k", *beside, "--trusted")
    assert seen == {"horns-acme.usdc": False, "horns.usdc": False}


@pytest.mark.parametrize(
    ("schemes", "made_by"),
    [([], ["apex"]), (["relief"], []), (["cho2007", "relief"], ["cho2007"])],
)
def test_the_master_is_made_by_the_layers_asked_for(schemes, made_by) -> None:
    from meshmark.commands.verification import Request, recipes_asked

    recipes = recipes_asked(schemes, "sdf", "heat", [])
    request = Request(Path("k"), "", recipes, named=bool(schemes), original="x")
    assert [layer.scheme for layer in request.master_layers] == made_by
