"""`meshmark report` and `embed --report`: what they write, refuse, and keep to themselves."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from command_line import command
from meshmark.keys import Key
from report_pages import RECIPIENT, outline


@pytest.fixture
def refused(tmp_path, monkeypatch, capsys):
    """Run a command that is to be refused; return its exit code and message."""
    monkeypatch.chdir(tmp_path)
    Key(bytes(range(32))).save(tmp_path / "k")

    def call(*arguments: object) -> tuple[int, str]:
        code = command(monkeypatch, *arguments)
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == 1, lines
        assert sorted(path.name for path in tmp_path.iterdir()) == ["k"]
        return code, lines[0]

    return call


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (("-o", "report.usdc"), "a report is an HTML page"),
        (("-o", "r.html", "--master", "m.usdc"), "--master needs --original"),
        (("-o", "r.html", "--ledger", "l", "--original", "o.usdc"), "--ledger names original"),
        (("-o", "r.html", "--ledger", "l", "--recipient", "acme"), "--ledger names original"),
        (("-o", "r.html", "--fpr", "0"), "--fpr must lie between"),
        (("-o", "r.html", "--ledger", "l", "--scheme", "apex"), "--ledger names original"),
    ],
)
def test_what_makes_no_sense_is_refused_before_any_work(refused, options, reason) -> None:
    code, told = refused("report", "copy.usdc", "--key", "k", *options)
    assert code == 2
    assert reason in told


def test_a_copy_that_is_not_there_is_told_of_in_one_line(refused) -> None:
    code, told = refused("report", "copy.usdc", "--key", "k", "-o", "r.html", "--trusted")
    assert code == 3
    assert "copy.usdc: no such file" in told


@pytest.mark.parametrize(
    ("options", "code"),
    [
        (("--report", "r.txt"), 2),
        (("--report", "r.html", "--dry-run"), 2),
        (("--report", "nowhere/r.html"), 3),
    ],
)
def test_embed_refuses_a_report_that_it_cannot_write(refused, options, code) -> None:
    assert refused("embed", "s.usdc", "-o", "o.usdc", "--key", "k", *options)[0] == code


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.slow
def test_both_pages_tell_files_and_commands_and_no_key(made) -> None:
    assert made.codes == (0, 0)
    secret = Key.load(made.folder / "studio.key").secret.hex()
    for page in (made.mark, made.copy):
        text = page.read_text("utf-8")
        heard = outline(text).heard
        assert secret not in text
        assert "studio.key" not in text
        assert digest(made.folder / "horns.usdc") in heard
        assert digest(made.folder / "m.usdc") in heard
    heard = outline(made.copy.read_text("utf-8")).heard
    assert f"Marked: this is the copy made for {RECIPIENT}" in heard
    [typed] = [text for text in heard if text.startswith("meshmark report")]
    assert typed == (
        "meshmark report m.usdc --key KEYFILE --output copy.html --scheme relief "
        f"--recipient '{RECIPIENT}' --original horns.usdc"
    )


@pytest.mark.slow
def test_the_same_copy_gives_the_same_page(made, monkeypatch) -> None:
    monkeypatch.chdir(made.folder)
    options = ("--key", "studio.key", "--scheme", "relief", "--original", "horns.usdc")
    again = (*options, "--recipient", RECIPIENT, "-o", "again.html")
    assert command(monkeypatch, "report", "m.usdc", *again) == 0
    text = (made.folder / "again.html").read_text("utf-8")
    assert text.replace("again.html", "copy.html") == made.copy.read_text("utf-8")


@pytest.mark.slow
def test_what_is_not_marked_has_a_page_and_its_exit_code(made, monkeypatch) -> None:
    monkeypatch.chdir(made.folder)
    Key(bytes(range(1, 33))).save(made.folder / "other.key")
    options = ("--key", "other.key", "--scheme", "relief", "--original", "horns.usdc", "--trusted")
    assert command(monkeypatch, "report", "m.usdc", *options, "-o", "other.html") == 1
    heard = outline((made.folder / "other.html").read_text("utf-8")).heard
    assert "Not marked: the mark was not found in this file" in heard


@pytest.mark.slow
def test_a_ledger_names_asset_recipient_and_original(made, monkeypatch, capsys) -> None:
    pytest.importorskip("sqlalchemy", reason="the extra ledger is not installed")
    monkeypatch.chdir(made.folder)
    assert command(monkeypatch, "ledger", "init", "--ledger", "l.db") == 0
    mark = ("--key", "studio.key", "--scheme", "relief", "--ledger", "l.db", "--trusted")
    for name in (RECIPIENT, "globex"):
        output = f"for-{len(name)}.usdc"
        assert (
            command(monkeypatch, "embed", "horns.usdc", "-o", output, *mark, "--recipient", name)
            == 0
        )
    options = ("--key", "studio.key", "--ledger", "l.db", "-o", "ledger.html", "--trusted")
    assert command(monkeypatch, "report", "for-6.usdc", *options) == 0
    heard = outline((made.folder / "ledger.html").read_text("utf-8")).heard
    [headline] = [text for text in heard if text.startswith("Marked: this is horns ")]
    assert headline.endswith("the copy made for globex")
    assert "What the ledger knows" in heard
    # One for the owner, and one for each recipient.
    assert "3" in heard[heard.index("keys, names and originals of the ledger") :][1]
    assert digest(made.folder / "horns.usdc") in heard


@pytest.mark.slow
def test_a_file_that_was_changed_meanwhile_has_no_page(made, monkeypatch, capsys) -> None:
    monkeypatch.chdir(made.folder)
    (made.folder / "leak.usdc").write_bytes((made.folder / "m.usdc").read_bytes())

    def exchanging(*_: object, **__: object) -> None:
        (made.folder / "leak.usdc").write_bytes(b"another")

    monkeypatch.setattr("meshmark.reporting.report.select", exchanging)
    options = ("--key", "studio.key", "--scheme", "relief", "--original", "horns.usdc", "--trusted")
    assert command(monkeypatch, "report", "leak.usdc", *options, "-o", "leak.html") == 3
    assert "leak.usdc: changed while it was read" in capsys.readouterr().err
    assert not (made.folder / "leak.html").exists()
