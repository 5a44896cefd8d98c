"""Stamps say on marked meshes that they are marked, and nothing that the owner keeps to himself."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from pxr import Sdf, Usd

from command_line import command
from meshmark.embedding.description import stamps_told
from meshmark.embedding.file import mark_file
from meshmark.errors import UsageError
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import as_asset
from meshmark.testing.meshes import bumpy_sphere
from meshmark.testing.schemas import schema_folder
from meshmark.usd.checking import check_stage
from meshmark.usd.delivery import write_flattened
from meshmark.usd.opening import open_stage
from meshmark.usd.plugin import register
from meshmark.usd.reading import read_stage
from meshmark.usd.stages import write_stage
from meshmark.usd.stamp import Stamp
from meshmark.usd.stamping import RECORD, SCHEMES, remove_stamps, stamp_note
from meshmark.usd.writing import write_override
from rigged_stages import bent_tube
from usd_stages import cube, moved, write_text

KEY = Key(bytes(range(32)))
STAMP = Stamp("0123456789abcdef" * 2, ("apex", "relief"))
FOREIGN = f"""
    def Mesh "m" (prepend apiSchemas = ["MeshmarkAPI", "GeomModelAPI"])
    {{
        uniform string {RECORD} = "{"f" * 32}"
        uniform token[] {SCHEMES} = ["apex"]
        %s
    }}
"""


@pytest.fixture
def source(tmp_path: Path) -> str:
    return write_text(tmp_path / "s.usda", cube("m"))


def note(file: Path, prim: str = "/m") -> str | None:
    stage = Usd.Stage.Open(str(file))
    return stamp_note(stage.GetPrimAtPath(prim))


def test_usd_learns_the_schema_without_an_environment(tmp_path: Path, source: str) -> None:
    original = read_stage(source)
    write_override(original, moved(original), tmp_path / "o.usda", stamps={"/m": STAMP})
    program = """if True:
        import sys
        from pxr import Usd
        if sys.argv[2:]:
            from meshmark.usd.plugin import register
            register()
            register()
        stage = Usd.Stage.Open(sys.argv[1])
        prim = stage.GetPrimAtPath("/m")
        known = Usd.SchemaRegistry().FindAppliedAPIPrimDefinition("MeshmarkAPI")
        print(prim.HasAPI("MeshmarkAPI"), *(known.GetPropertyNames() if known else []))
        print(prim.GetAttribute("meshmark:record").Get())
    """
    for more, expected in ((["register"], f"True {RECORD} {SCHEMES}"), ([], "False")):
        done = subprocess.run(
            [sys.executable, "-c", program, tmp_path / "o.usda", *more],
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout.splitlines() == [expected, STAMP.record]
        assert done.stderr == ""


def test_the_generated_schema_is_that_of_its_source() -> None:
    folder = Path(sys.modules[register.__module__].__file__).parent
    source = Sdf.Layer.FindOrOpen(str(folder / "schema.usda"))
    made = Sdf.Layer.FindOrOpen(str(folder / "generatedSchema.usda"))
    [api] = made.rootPrims
    same = source.GetPrimAtPath(api.path)
    assert api.specifier == same.specifier == Sdf.SpecifierClass
    assert api.documentation == same.documentation
    for one, other in zip(api.properties, same.properties, strict=True):
        assert (one.name, one.typeName, one.variability) == (
            other.name,
            other.typeName,
            other.variability,
        )
        assert one.documentation == other.documentation
    told = json.loads((folder / "plugInfo.json").read_text())["Plugins"][0]
    assert told["Name"] == source.GetPrimAtPath("/GLOBAL").customData["libraryName"]


def test_an_override_is_stamped_if_it_is_to_be(tmp_path: Path, source: str) -> None:
    original = read_stage(source)
    for name, stamps, expected in (
        ("with", {"/m": STAMP}, f"stamped: marked by apex, relief, record {STAMP.record}"),
        ("without", {}, None),
    ):
        write_override(original, moved(original), tmp_path / f"{name}.usda", stamps=stamps)
        assert note(tmp_path / f"{name}.usda") == expected
    assert open_stage(str(tmp_path / "with.usda")).warnings == ()
    [mesh] = read_stage(str(tmp_path / "with.usda")).meshes
    assert f"stamped: marked by apex, relief, record {STAMP.record}" in mesh.notes


def test_a_baked_rig_keeps_what_else_is_applied_to_it(tmp_path: Path) -> None:
    original = read_stage(bent_tube(tmp_path / "rig.usda"))
    [mesh] = original.meshes
    write_override(original, moved(original), tmp_path / "o.usda", stamps={mesh.prim: STAMP})
    stage = Usd.Stage.Open(str(tmp_path / "o.usda"))
    applied = stage.GetPrimAtPath(mesh.prim).GetMetadata("apiSchemas").GetAddedOrExplicitItems()
    assert set(applied) == {"SkelBindingAPI", "MeshmarkAPI"}


def test_a_deliverable_has_no_stamp_but_its_own(tmp_path: Path) -> None:
    body = FOREIGN % cube().split("{", 1)[1].rsplit("}", 1)[0] + FOREIGN.replace('"m"', '"n"') % ""
    source = write_text(tmp_path / "s.usda", body)
    assert "marked by apex," in note(Path(source))
    original = read_stage(source, ["/m"])
    done = write_flattened(original, moved(original), tmp_path / "bare.usda")
    assert set(done.removed) >= {"/m: says that it is marked", "/n: says that it is marked"}
    assert not any(word in (tmp_path / "bare.usda").read_text() for word in ("arkAPI", "meshmark"))
    assert "GeomModelAPI" in (tmp_path / "bare.usda").read_text()

    write_flattened(original, moved(original), tmp_path / "own.usda", stamps={"/m": STAMP})
    assert STAMP.record in note(tmp_path / "own.usda")
    assert note(tmp_path / "own.usda", "/n") is None
    assert "fff" not in (tmp_path / "own.usda").read_text()
    assert check_stage(str(tmp_path / "own.usda"), stamps=[STAMP]) == []
    [found] = check_stage(str(tmp_path / "own.usda"))
    assert (found.kind, found.where, found.what) == ("metadata", "/m", "says that it is marked")

    write_flattened(original, moved(original), tmp_path / "kept.usda", keep_metadata=True)
    assert "f" * 32 in note(tmp_path / "kept.usda")


@pytest.mark.parametrize(
    "more",
    [
        'string meshmark:show = "secret"',
        f'uniform string {RECORD} = "{STAMP.record}" (doc = "for acme")',
        f'uniform string {RECORD} = "acme"',
        f'uniform string {RECORD}.timeSamples = {{ 1: "acme" }}',
        f'uniform token[] {SCHEMES} = ["apex", "a scheme\\n"]',
    ],
)
def test_more_than_a_stamp_is_none(more: str) -> None:
    stamp = f'uniform string {RECORD} = "{STAMP.record}"\nuniform token[] {SCHEMES} = ["apex"]'
    name = more.split("=")[0].removesuffix(".timeSamples ").split()[-1]
    lines = [line for line in stamp.splitlines() if f"{name} " not in line]
    layer = Sdf.Layer.CreateAnonymous(".usda")
    text = 'def Mesh "m" (apiSchemas = ["MeshmarkAPI"]) {\n%s\n}'
    kept = [Stamp(STAMP.record, ("apex",))]
    layer.ImportFromString("#usda 1.0\n" + text % stamp)
    assert remove_stamps(layer, kept) == []
    layer.ImportFromString("#usda 1.0\n" + text % "\n".join([*lines, more]))
    assert remove_stamps(layer, kept) == ["/m: says that it is marked"]
    prim = layer.GetPrimAtPath("/m")
    assert list(prim.properties) == []
    assert not prim.HasInfo("apiSchemas")


def test_what_strangers_stamp_is_not_printed(tmp_path: Path) -> None:
    file = tmp_path / "s.usda"
    write_text(file, FOREIGN.replace("f" * 32, "\\u001b[31m") % "")
    assert note(file) == "stamped, by something else than meshmark"


@pytest.fixture
def ball(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    mesh = MeshAnimation.from_arrays(*bumpy_sphere(3, np.eye(3)), prim="/ball")
    write_stage(as_asset(mesh), Path("s.usdc"))
    return "s.usdc"


def test_a_stamp_names_the_run_and_not_the_recipient(ball: str) -> None:
    for name, recipient in (("a", "acme"), ("b", "globex"), ("there/a", "acme")):
        output = Path(f"{name}.usda")
        output.parent.mkdir(exist_ok=True)
        run = {"recipe": Recipe("cho2007"), "recipient": recipient, "deliver": True}
        document = mark_file(ball, output, KEY, stamp=True, **run).document
        schema = json.loads((schema_folder("json") / "manifest.schema.json").read_text())
        jsonschema.validate(document, schema)
        assert stamps_told(document) == {"/ball": Stamp(document["record"], ("cho2007",))}
        assert document["record"] in note(output, "/ball")
        assert not any(word in output.read_text() for word in (recipient, KEY.id))
    assert Path("a.usda").read_bytes() == Path("there/a.usda").read_bytes()
    assert note("a.usda", "/ball") != note("b.usda", "/ball")


def test_stamps_on_the_command_line(
    ball: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    embed = ("embed", ball, "-o", "a.usda", "--key", "k", "--scheme", "cho2007", "--deliver")
    KEY.save(Path("k"))
    assert command(monkeypatch, *embed, "--stamp", "--trusted") == 0
    assert command(monkeypatch, "check", "a.usda", "--trusted") == 0
    assert command(monkeypatch, "inspect", "a.usda", "--scheme", "cho2007", "--trusted") == 0
    assert "note: stamped: marked by cho2007, record " in capsys.readouterr().out
    Path("a.usda.meshmark.json").unlink()
    assert command(monkeypatch, "check", "a.usda", "--trusted") == 1
    assert "metadata: /ball: says that it is marked" in capsys.readouterr().out


def test_stamps_are_for_stages(tmp_path: Path, source: str) -> None:
    with pytest.raises(UsageError, match="USD"):
        mark_file(source, tmp_path / "o.obj", KEY, recipe=Recipe("cho2007"), stamp=True)
