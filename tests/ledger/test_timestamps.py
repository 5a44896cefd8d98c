"""Time stamps on the chain, by an authority of the tests' own, verified offline ever after."""

from __future__ import annotations

from pathlib import Path

import pytest

from meshmark.errors import InputError
from meshmark.ledger.chain import canonical
from meshmark.ledger.checking import check
from meshmark.ledger.database import database
from meshmark.ledger.stamping import stamp_by, stamp_from, write_request
from meshmark.ledger.store import Ledger, init
from meshmark.ledger.timestamp import read_reply, read_roots, verified
from time_authority import Authority

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def authority(tmp_path_factory: pytest.TempPathFactory) -> Authority:
    return Authority.founded(tmp_path_factory.mktemp("tsa") / "one", "Ours")


@pytest.fixture(scope="module")
def stranger(tmp_path_factory: pytest.TempPathFactory) -> Authority:
    return Authority.founded(tmp_path_factory.mktemp("tsa") / "two", "Stranger")


@pytest.fixture
def ledger(tmp_path: Path) -> Ledger:
    where = str(tmp_path / "studio.ledger")
    init(where)
    kept = Ledger(where)
    for n in range(3):
        kept.append({"kind": "mark", "asset": f"asset {n}"})
    return kept


def test_an_authority_is_asked_and_its_stamp_holds_offline(
    ledger: Ledger, authority: Authority, tmp_path: Path
) -> None:
    with authority.serving() as url:
        done = stamp_by(ledger, url, authority.root)
    entry = done.link.entry
    assert (entry["sequence"], entry["of"], entry["tsa"]) == (4, 3, url)
    assert entry["hash"] == ledger.link(3).hash
    ledger.append({"kind": "mark", "asset": "later"})
    # Nobody is asked any more.
    found = check(ledger)
    assert not found.findings
    assert [(each.of, each.time) for each in found.stamps] == [(3, entry["time"])]
    assert not check(ledger, authority.root).findings
    assert not check(ledger, noted=ledger.link(2).hash).findings
    # openssl takes the entry's hash for what was stamped, too.
    (authority.folder / "kept").write_bytes(read_reply(authority.folder / "reply"))
    options = ("-digest", entry["hash"], "-in", "kept", "-CAfile", "root.pem")
    assert "OK" in authority.run("ts", "-verify", *options)


def test_a_reply_is_brought_in_a_file(ledger: Ledger, authority: Authority, tmp_path: Path) -> None:
    assert write_request(ledger, tmp_path / "query") == 3
    ledger.append({"kind": "mark", "asset": "meanwhile"})
    (tmp_path / "reply").write_bytes(authority.reply((tmp_path / "query").read_bytes()))
    done = stamp_from(ledger, tmp_path / "reply", authority.root)
    assert (done.link.sequence, done.link.entry["of"]) == (5, 3)
    assert not stamp_from(ledger, tmp_path / "reply", authority.root).new
    assert not check(ledger).findings


def test_what_is_not_to_be_trusted_is_not_recorded(
    ledger: Ledger, authority: Authority, stranger: Authority, tmp_path: Path
) -> None:
    with stranger.serving() as url:
        for path, words in (
            ("", "no time stamp to be trusted"),
            ("nonsense", "no time stamp to be trusted"),
            ("broken", "does not answer"),
        ):
            with pytest.raises(InputError, match=words):
                stamp_by(ledger, url + path, authority.root)
    for url in ("http://127.0.0.1:1/", "ftp://127.0.0.1/", "http://", "nonsense"):
        with pytest.raises(InputError):
            stamp_by(ledger, url, authority.root)
    for root in (tmp_path, tmp_path / "none", Path(__file__)):
        with pytest.raises(InputError):
            stamp_by(ledger, "http://127.0.0.1:1/", root)
    assert ledger.head()[0] == 3


def test_der_is_taken_strictly(ledger: Ledger, authority: Authority, tmp_path: Path) -> None:
    write_request(ledger, tmp_path / "query")
    reply = authority.reply((tmp_path / "query").read_bytes())
    roots = read_roots(authority.root)
    assert verified(reply, roots, "reply").imprint == ledger.head()[1]
    for other in (reply + b"\0", reply[:-1], b"", b"\x30\x80" + reply[4:] + b"\0\0"):
        with pytest.raises(InputError, match="no time stamp to be trusted"):
            verified(other, roots, "reply")
    # Not one byte of what is signed, or of the signature, can be another.
    for place in range(60, len(reply), 97):
        other = bytearray(reply)
        other[place] ^= 1
        try:
            stamp = verified(bytes(other), roots, "reply")
        except InputError:
            continue
        assert stamp == verified(reply, roots, "reply"), place


def test_a_reply_on_something_else_is_refused(
    ledger: Ledger, authority: Authority, tmp_path: Path
) -> None:
    authority.run("ts", "-query", "-digest", 64 * "a", "-sha256", "-cert", "-out", "other")
    (tmp_path / "reply").write_bytes(authority.reply((authority.folder / "other").read_bytes()))
    with pytest.raises(InputError, match="is about no entry"):
        stamp_from(ledger, tmp_path / "reply", authority.root)
    authority.run("ts", "-query", "-digest", 128 * "a", "-sha512", "-cert", "-out", "other")
    (tmp_path / "reply").write_bytes(authority.reply((authority.folder / "other").read_bytes()))
    with pytest.raises(InputError, match="no SHA-256"):
        stamp_from(ledger, tmp_path / "reply", authority.root)


def test_another_history_does_not_fit_the_stamp(
    ledger: Ledger, authority: Authority, stranger: Authority, tmp_path: Path
) -> None:
    noted = ledger.head()[1]
    with authority.serving() as url:
        stamp_by(ledger, url, authority.root)
    stamp = ledger.entry(4)
    # Somebody writes the ledger again, every hash included, and keeps the stamp.
    where = str(tmp_path / "forged.ledger")
    init(where)
    forged = Ledger(where)
    for n in range(3):
        forged.append({"kind": "mark", "asset": f"asset {n}", "recipient": "nobody"})
    told = ("sequence", "recorded_at", "recorded_by")
    forged.append({name: value for name, value in stamp.items() if name not in told})
    [finding] = check(forged).findings
    assert (finding.sequence, finding.kind) == (4, "timestamp")
    [_, finding] = check(forged, noted=noted).findings
    assert noted in finding.what
    # Roots that somebody trusts are another matter than those that are kept.
    [finding] = check(ledger, stranger.root).findings
    assert (finding.sequence, finding.kind) == (4, "timestamp")


def test_an_altered_stamp_is_an_altered_entry(
    ledger: Ledger, authority: Authority, tmp_path: Path
) -> None:
    with authority.serving() as url:
        stamp_by(ledger, url, authority.root)
    body = canonical({**ledger.entry(4), "time": "2001-01-01T00:00:00+00:00"})
    with database(ledger.name).engine.begin() as connection:
        connection.exec_driver_sql("DROP TRIGGER entries_stay")
        connection.exec_driver_sql("UPDATE ledger_entries SET body = ? WHERE sequence = 4", (body,))
    found = check(ledger)
    assert [(each.sequence, each.kind) for each in found.findings] == [(4, "changed")]
    assert not found.stamps
