"""`embed --c2pa` and `c2pa verify`: copy and sidecar are there together, and tell nobody's name."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from certificates import Holder
from command_line import command
from meshmark.c2pa import sidecar
from meshmark.c2pa.signing import Signer
from meshmark.commands.attack import write_attacked
from meshmark.embedding import credentials, file
from meshmark.embedding.manifest import manifest_path, output_hashes
from meshmark.errors import InputError, OutputError
from meshmark.keys import Key
from meshmark.ledger.store import Ledger, init
from meshmark.mesh.asset import as_asset
from meshmark.testing.informed_schemes import horned
from meshmark.testing.schemas import schema_folder

MARK = ("embed", "horns.usdc", "--key", "k", "--scheme", "relief", "--trusted", "-o")
SIGN = ("--c2pa", "signer.pem", "--c2pa-key", "signer.key")
NAME = "Zoë of Acme"
HORNS = Path("horns.usdc")


def found_studio(folder: Path) -> None:
    """Make a source, a key, and who signs, in a folder."""
    write_attacked(as_asset(horned()), folder / "horns.usdc")
    Key(bytes(range(32))).save(folder / "k")
    root = Holder.named("root")
    (folder / "root.pem").write_bytes(root.pem)
    (folder / "other.pem").write_bytes(Holder.named("root").pem)
    signer = Holder.named("publishing", Holder.named("middle", root), signs=True)
    signer.save(folder, "signer")


@pytest.fixture(scope="module")
def studios(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("studio")
    found_studio(folder)
    return folder


@pytest.fixture
def run(
    studios: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> Callable[..., tuple[int, str, list[str]]]:
    shutil.copytree(studios, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)

    def call(*arguments: object) -> tuple[int, str, list[str]]:
        code = command(monkeypatch, *arguments)
        captured = capsys.readouterr()
        return code, captured.out, captured.err.splitlines()

    return call


def failed(outcome: tuple[int, str, list[str]], code: int, *words: str) -> None:
    """Fail unless it ended with a code and one line of error that has these words."""
    got, _, err = outcome
    assert got == code, err
    errors = [line for line in err if line.startswith("error: ")]
    assert len(errors) == 1, err
    assert all(word in errors[0] for word in words), errors


def state() -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in Path().iterdir() if path.is_file()}


def test_who_cannot_sign_does_not_start(
    run: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def marked(*_: Any, **__: Any) -> Any:
        raise AssertionError("work was done")

    monkeypatch.setattr(file, "embed", marked)
    before = state()
    mark = (*MARK, "copy.usdc")
    failed(run(*mark, "--c2pa", "signer.pem"), 2, "--c2pa and --c2pa-key go together")
    failed(run(*mark, "--c2pa-key", "signer.key"), 2, "--c2pa and --c2pa-key go together")
    failed(run(*mark, "--c2pa", "k", "--c2pa-key", "signer.key"), 3, "no certificates")
    failed(run(*mark, "--c2pa", "signer.pem", "--c2pa-key", "k"), 3, "no private key")
    failed(run(*mark, "--c2pa", "root.pem", "--c2pa-key", "signer.key"), 3, "is not the key of")
    failed(run(*MARK, "copy.gltf", *SIGN), 2, "--c2pa signs one of")
    Path("copy.c2pa").write_bytes(b"another's")
    failed(run(*mark, *SIGN), 3, "copy.c2pa", "is in the way")
    assert state() == before | {"copy.c2pa": b"another's"}


def test_a_missing_extra_is_named(run: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sidecar, "find_spec", lambda _: None)
    words = ("c2pa-python", "pip install 'meshmark[c2pa]'")
    failed(run(*MARK, "copy.usdc", *SIGN), 2, *words)
    failed(run("c2pa", "verify", "copy.usdc"), 2, *words)


def test_what_has_no_sidecar_is_told_of(run: Callable[..., Any]) -> None:
    failed(run("c2pa", "verify", "horns.usdc"), 3, "horns.c2pa")
    Path("horns.c2pa").write_bytes(b"nothing")
    failed(run("c2pa", "verify", "horns.usdc"), 3, "is no sidecar that can be read")
    failed(run("c2pa", "verify", "none.usdc", "--sidecar", "horns.c2pa"), 3, "none.usdc")


def test_names_of_strangers_do_not_speak_to_the_terminal(run: Callable[..., Any]) -> None:
    stranger = Holder.named("\x1b[2Jtrusted\r\n", signs=True)
    signer = Signer.of(*stranger.save(Path(), "stranger"))
    content = signer.sidecar(Path("horns.usdc"), "\x1b]0;x\x07", ["\x07"])
    Path("horns.c2pa").write_bytes(content)
    code, _, err = run("c2pa", "verify", "horns.usdc")
    assert code == 4
    assert len(err) == 2
    assert all(line.isprintable() for line in err)


@pytest.mark.parametrize("layers", [[1], [{}], None, [{"name": "x", "version": "1"}]])
def test_a_strangers_manifest_is_compared_at_most(run: Callable[..., Any], layers: Any) -> None:
    signer = Signer.of(Path("signer.pem"), Path("signer.key"))
    Path("horns.c2pa").write_bytes(signer.sidecar(Path("horns.usdc"), "ab" * 16, ["meshmark.y.1"]))
    manifest = {"record": "ab" * 16, "layers": layers, "output_files": output_hashes(HORNS)}
    manifest_path(HORNS).write_text(json.dumps(manifest))
    outcome = run("c2pa", "verify", HORNS, "--anchors", "root.pem")
    if layers and isinstance(layers[0], dict) and layers[0]:
        failed(outcome, 1, "another record, or of other schemes")
    else:
        assert outcome[0] == 0


@pytest.mark.slow
def test_a_copy_is_signed_and_checked(run: Callable[..., Any]) -> None:
    init("studio.ledger")
    record = ("--ledger", "studio.ledger")
    code, out, err = run(*MARK, "copy.usdc", *SIGN, *record, "--recipient", NAME, "--json")
    assert code == 0, err
    manifest = json.loads(out)
    schema = json.loads((schema_folder("json") / "manifest.schema.json").read_text())
    jsonschema.validate(manifest, schema)
    assert f"copy.c2pa: signed, record {manifest['record']}" in err
    [version] = [layer["version"] for layer in manifest["layers"]]
    check = ("c2pa", "verify", "copy.usdc")
    code, out, err = run(*check, "--anchors", "root.pem", *record, "--json")
    assert code == 0, err
    answer = json.loads(out)
    jsonschema.validate(
        answer, json.loads((schema_folder("json") / "c2pa.schema.json").read_text())
    )
    assert answer == {
        "file": "copy.usdc",
        "sidecar": "copy.c2pa",
        "verdict": "trusted",
        "signer": "publishing",
        "issuer": "Studio",
        "trusted": True,
        "stamped": None,
        "bindings": [{"alg": f"meshmark.relief.{version}", "value": manifest["record"]}],
        "manifest": True,
        "entries": [1],
        "problems": [],
    }
    # Whom to trust is the user's to say.
    assert run(*check)[0] == 4
    failed(run(*check, "--anchors", "other.pem"), 1, "no certificate in other.pem")
    # Nobody asked for stamps, so none is missed.
    assert "stamp" not in run("check", "copy.usdc")[1]
    # What travels with the copy tells nothing that an outsider could use.
    said = Path("copy.c2pa").read_bytes()
    # None is so short that a signature has it by chance.
    for word in (NAME, "Acme", "horns", "copy", manifest["key_id"]):
        assert word.encode() not in said, word
    # The same call leaves both as they are.
    before = state()
    code, _, err = run(*MARK, "copy.usdc", *SIGN, "--recipient", NAME)
    assert "left as it is" in " ".join(err)
    assert state() == before
    # Another recipient's sidecar says another record.
    assert run(*MARK, "other.usdc", *SIGN, *record, "--recipient", "other")[0] == 0
    swapped = run(*check, "--sidecar", "other.c2pa", "--anchors", "root.pem")
    assert swapped[0] == 1
    assert "not the file that was signed" in " ".join(swapped[2])
    assert "the manifest beside it tells of another record" in " ".join(swapped[2])
    # A copy that lies alone is checked as well; a ledger that does not know it says so.
    Path("copy.usdc.meshmark.json").unlink()
    assert run(*check, "--anchors", "root.pem")[0] == 0
    init("empty.ledger")
    failed(run(*check, "--ledger", "empty.ledger"), 1, "no entry of the ledger has its record")
    content = bytearray(Path("copy.usdc").read_bytes())
    content[len(content) // 2] ^= 1
    Path("copy.usdc").write_bytes(content)
    failed(run(*check, "--anchors", "root.pem"), 1, "not the file that was signed")


@pytest.mark.slow
def test_copy_and_sidecar_are_there_together(
    run: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: Any) -> Any:
        raise InputError("nothing can be signed with it", source="signer.pem")

    def full(*_: Any) -> Any:
        raise OutputError("no space left", source="copy.c2pa")

    before = state()
    with monkeypatch.context() as patch:
        patch.setattr(Signer, "sidecar", refused)
        failed(run(*MARK, "copy.usdc", *SIGN), 3, "nothing can be signed")
        assert state() == before
    with monkeypatch.context() as patch:
        patch.setattr(credentials, "write_bytes", full)
        failed(run(*MARK, "copy.usdc", *SIGN), 3, "no space left")
        assert state() == before
    assert run(*MARK, "copy.usdc", *SIGN)[0] == 0
    before = state()
    # What stood there comes back where entry or manifest cannot be written.
    init("studio.ledger")
    with monkeypatch.context() as patch:
        patch.setattr(Ledger, "append", full)
        mark = (*MARK, "copy.usdc", *SIGN, "--set", "relief.slope=0.3")
        failed(run(*mark, "--ledger", "studio.ledger"), 3, "no space left")
    after = state()
    assert {name: after[name] for name in before} == before
    # Where the sidecar is lost, the copy is not taken for made.
    Path("copy.c2pa").unlink()
    assert run(*MARK, "copy.usdc", *SIGN)[0] == 0
    assert run("c2pa", "verify", "copy.usdc", "--anchors", "root.pem")[0] == 0
    assert run(*MARK, "dry.usdc", *SIGN, "--dry-run")[0] == 0
    assert not Path("dry.c2pa").exists()
