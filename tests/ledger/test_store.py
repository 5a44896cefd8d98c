"""Entries are appended, and stay; what is done behind the ledger's back is found."""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from alembic.script import ScriptDirectory

from database_server import Server
from meshmark.errors import InputError, MeshmarkError, OutputError, UsageError
from meshmark.ledger import store
from meshmark.ledger.database import database
from meshmark.ledger.schema import REVISION, metadata
from meshmark.ledger.store import MIGRATIONS, Ledger, init

WRITERS = 200


def content(n: int, recipient: str = "acme") -> dict[str, Any]:
    return {"kind": "mark", "asset": f"asset {n}", "recipient": recipient, "manifest": {"n": n}}


def filled(where: str, n: int = 5) -> Ledger:
    init(where)
    ledger = Ledger(where)
    for k in range(1, n + 1):
        ledger.append(content(k))
    return ledger


def tampered(where: str, *statements: str) -> None:
    """Alter a ledger as whoever owns the database can: without its triggers."""
    with database(where).engine.begin() as connection:
        if connection.dialect.name == "sqlite":
            query = "SELECT name FROM sqlite_master WHERE type = 'trigger'"
            drops = [f"DROP TRIGGER {row[0]}" for row in connection.exec_driver_sql(query)]
        else:
            drops = [
                f"ALTER TABLE {table} DISABLE TRIGGER ALL"
                for table in ("ledger_entries", "ledger_head")
            ]
        for statement in (*drops, *statements):
            connection.exec_driver_sql(statement)


def found(ledger: Ledger) -> list[tuple[int, str]]:
    return [(each.sequence, each.kind) for each in ledger.findings()]


def test_what_is_appended_is_read_again(where: str) -> None:
    ledger = filled(where, 0)
    assert ledger.head() == (0, 64 * "0")
    assert not found(ledger)
    first = ledger.append(content(1, "Zoë 张伟 🐎"))
    assert first.new
    assert not first.behind
    ledger.append(content(2))
    assert [entry["recipient"] for entry in ledger.entries()] == ["Zoë 张伟 🐎", "acme"]
    [only] = ledger.entries(recipient="Zoë 张伟 🐎")
    assert only == ledger.entry(1)
    assert only["manifest"] == {"n": 1}
    assert only["recorded_by"]
    age = datetime.now(UTC) - datetime.fromisoformat(only["recorded_at"])
    assert timedelta(0) <= age < timedelta(minutes=5)
    assert ledger.head() == (2, ledger.link(2).hash)
    assert ledger.with_hash(ledger.link(1).hash, "here").sequence == 1
    with pytest.raises(InputError, match="no entry 3"):
        ledger.entry(3)
    assert not found(ledger)


def test_the_same_is_recorded_once(where: str) -> None:
    ledger = filled(where)
    again = ledger.append(content(3))
    assert not again.new
    assert again.link.sequence == 3
    assert ledger.head()[0] == 5


@pytest.mark.slow
def test_the_tables_are_those_of_the_newest_migration(where: str) -> None:
    assert ScriptDirectory(str(MIGRATIONS)).get_heads() == [REVISION]
    assert init(where)[1] is None
    assert init(where)[1] == REVISION
    from alembic.autogenerate import compare_metadata
    from alembic.migration import MigrationContext

    with database(where).engine.connect() as connection:
        options = {"version_table": "ledger_version"}
        context = MigrationContext.configure(connection, opts=options)
        assert compare_metadata(context, metadata) == []


@pytest.mark.slow
def test_several_make_the_same_ledger_at_once(where: str) -> None:
    start, found = threading.Barrier(8), []

    def make() -> None:
        start.wait()
        try:
            found.append(init(where)[1])
        except MeshmarkError as error:
            found.append(str(error))

    makers = [threading.Thread(target=make) for _ in range(8)]
    for each in makers:
        each.start()
    for each in makers:
        each.join()
    # One has made it, the others found it.
    assert sorted(found, key=str) == [*[REVISION] * 7, None]
    filled(where)
    assert not list(Ledger(where).findings())


@pytest.mark.slow
def test_other_schemas_are_refused_in_one_line(where: str) -> None:
    filled(where)
    tampered(where, "UPDATE ledger_version SET version_num = '999'")
    with pytest.raises(InputError, match="schema 999 of a newer meshmark"):
        Ledger(where)
    with pytest.raises(InputError, match="schema 999 of a newer meshmark"):
        init(where)


@pytest.mark.slow
def test_older_schemas_are_brought_up_by_init_only(
    where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    filled(where)
    monkeypatch.setattr(store, "REVISION", "2")
    with pytest.raises(InputError, match="older schema 1; `meshmark ledger init` brings it to 2"):
        Ledger(where)


@pytest.mark.slow
@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE ledger_entries SET recipient = 'nobody' WHERE sequence = 2",
        "DELETE FROM ledger_entries WHERE sequence = 5",
        "UPDATE ledger_head SET sequence = 4",
        "UPDATE ledger_head SET id = 2",
        "DELETE FROM ledger_head",
        "INSERT INTO ledger_head VALUES (2, 0, '')",
        "INSERT INTO ledger_entries SELECT 9, kind, asset, version, recipient, key_id, 'r', body, "
        "previous, 'h' FROM ledger_entries WHERE sequence = 2",
        "INSERT OR REPLACE INTO ledger_entries SELECT sequence, kind, asset, version, 'nobody', "
        "key_id, record, body, previous, hash FROM ledger_entries WHERE sequence = 2",
        "INSERT OR REPLACE INTO ledger_entries SELECT 6, kind, asset, version, 'nobody', key_id, "
        "record, body, previous, 'h' FROM ledger_entries WHERE sequence = 2",
        "INSERT OR REPLACE INTO ledger_head VALUES (1, 4, '')",
        "TRUNCATE ledger_entries",
        "TRUNCATE ledger_head",
    ],
)
def test_the_database_refuses_to_alter_it(where: str, statement: str) -> None:
    ledger = filled(where)
    engine = database(where).engine
    with pytest.raises(Exception, match=r"append-only|syntax"), engine.begin() as connection:
        connection.exec_driver_sql(statement)
    assert not found(ledger)


def test_a_flipped_byte_is_named(where: str) -> None:
    ledger = filled(where)
    body = "replace(body, 'asset 3', 'asset 8')"
    tampered(where, f"UPDATE ledger_entries SET body = {body} WHERE sequence = 3")
    assert found(ledger) == [(3, "changed")]
    with pytest.raises(InputError, match="entry 3 was changed"):
        ledger.entry(3)
    with pytest.raises(InputError, match="entry 3 was changed"):
        list(ledger.entries())


@pytest.mark.slow
@pytest.mark.parametrize("byte", [b"8", b"\xff", b"\x00"])
def test_a_byte_flipped_in_the_file_is_named(tmp_path: Path, byte: bytes) -> None:
    path = tmp_path / "studio.ledger"
    ledger = filled(str(path))
    data = path.read_bytes()
    assert data.count(b'{"n":4}') == 1
    path.write_bytes(data.replace(b'{"n":4}', b'{"n":' + byte + b"}"))
    assert found(ledger) == [(4, "changed")]


@pytest.mark.slow
@pytest.mark.parametrize("sequence", [1, 3, 5])
def test_a_deleted_row_is_named(where: str, sequence: int) -> None:
    ledger = filled(where)
    tampered(where, f"DELETE FROM ledger_entries WHERE sequence = {sequence}")
    assert found(ledger) == [(sequence, "missing")]


@pytest.mark.slow
def test_nothing_is_appended_to_a_damaged_end(where: str) -> None:
    ledger = filled(where)
    tampered(where, "DELETE FROM ledger_entries WHERE sequence = 5")
    with pytest.raises(OutputError, match="end of the chain is damaged"):
        ledger.append(content(6))
    assert found(ledger) == [(5, "missing")]


def test_a_swapped_pair_is_named(where: str) -> None:
    ledger = filled(where)
    moves = [(2, 92), (3, 2), (92, 3)]
    tampered(
        where,
        *(f"UPDATE ledger_entries SET sequence = {b} WHERE sequence = {a}" for a, b in moves),
    )
    assert found(ledger) == [(2, "re-ordered"), (3, "re-ordered")]


@pytest.mark.slow
def test_a_changed_column_is_named(where: str) -> None:
    ledger = filled(where)
    tampered(where, "UPDATE ledger_entries SET recipient = 'globex' WHERE sequence = 2")
    assert found(ledger) == [(2, "changed")]


@pytest.mark.slow
def test_a_clock_that_was_set_back_is_told_of(where: str, monkeypatch: pytest.MonkeyPatch) -> None:
    ledger = filled(where)

    class Late(datetime):
        @classmethod
        def now(cls, tz: Any = None) -> datetime:
            return datetime.now(tz) - timedelta(hours=2)

    monkeypatch.setattr(store, "datetime", Late)
    done = ledger.append(content(6))
    assert done.new
    assert done.behind == pytest.approx(7200, abs=60)
    assert not found(ledger)
    monkeypatch.undo()
    assert not ledger.append(content(7)).behind


def together(n: int, work: Callable[[int], object]) -> list[BaseException]:
    """Let n threads do something at once, and return what they raised."""
    ready, raised = threading.Barrier(n), []

    def run(k: int) -> None:
        try:
            ready.wait()
            work(k)
        except BaseException as error:
            raised.append(error)

    threads = [threading.Thread(target=run, args=(k,)) for k in range(n)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return raised


@pytest.mark.parametrize("n", [8, pytest.param(WRITERS, marks=pytest.mark.slow)])
def test_many_writers_at_once(where: str, n: int) -> None:
    init(where)
    ledgers = [Ledger(where) for _ in range(n)]
    # Every entry twice, by two of them.
    assert not together(n, lambda k: ledgers[k].append(content(k // 2)))
    ledger = ledgers[0]
    assert ledger.head()[0] == n // 2
    assert not found(ledger)
    assert sorted(entry["manifest"]["n"] for entry in ledger.entries()) == list(range(n // 2))


@pytest.mark.slow
@pytest.mark.parametrize("twice", [False, True])
def test_two_hundred_connections_at_once(postgresql: Server, twice: bool) -> None:
    where = postgresql.create(f"many {twice}")
    ledger = filled(where, 0)
    held: list[int] = []

    def work(k: int) -> None:
        # All are connected, and wait for the lock, before the first may write.
        with database(where).reading():
            held.append(k)
            everybody.wait()
            ledger.append(content(0 if twice else k))

    everybody = threading.Barrier(WRITERS // 2)
    assert not together(WRITERS // 2, work)
    assert ledger.head()[0] == (1 if twice else WRITERS // 2)
    assert not found(ledger)


@pytest.mark.parametrize(
    "text",
    [
        "mysql://td:secret@db/studio",
        "sqlite://",
        "sqlite+other:///x",
        "postgresql+psycopg2://td:secret@db/studio",
        "postgresql://td:secret@db:port/studio",
        "://",
        "http://td:secret@db",
        "",
        "/",
    ],
)
def test_other_urls_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--ledger takes") as refused:
        database(text)
    assert "secret" not in str(refused.value)


@pytest.mark.slow
@pytest.mark.parametrize("url", ["{}", "sqlite:///{}"])
def test_what_is_no_ledger_is_refused(tmp_path: Path, url: str) -> None:
    def refused(path: Path) -> str:
        with pytest.raises(InputError) as error:
            Ledger(url.format(path))
        return str(error.value)

    assert "there is no ledger; make one with `meshmark ledger init`" in refused(tmp_path / "none")
    assert not (tmp_path / "none").exists()
    assert "there is no ledger" in refused(tmp_path)
    (tmp_path / "text").write_text("this is no database, whatever its name says" * 100)
    assert "file is not a database" in refused(tmp_path / "text")
    sqlite3.connect(tmp_path / "empty").close()
    assert "is no ledger" in refused(tmp_path / "empty")
    sqlite3.connect(tmp_path / "other").execute("CREATE TABLE a (b)")
    assert "is no ledger" in refused(tmp_path / "other")


def test_a_server_that_is_not_there() -> None:
    url = "postgresql://td:secret@127.0.0.1:1/studio"
    for call in (Ledger, init):
        with pytest.raises(MeshmarkError, match="refused") as error:
            call(url)
        assert error.value.exit_code == 3
        assert "secret" not in str(error.value)


@pytest.mark.slow
def test_writers_need_no_more_rights_than_the_page_says(postgresql: Server) -> None:
    name = "rights"
    ledger = filled(postgresql.create(name), 1)
    for statement in (
        "CREATE ROLE writer LOGIN",
        "GRANT SELECT, INSERT ON ledger_entries TO writer",
        "GRANT SELECT, UPDATE ON ledger_head TO writer",
        "GRANT SELECT ON ledger_version TO writer",
        "CREATE ROLE reader LOGIN",
        "GRANT SELECT ON ledger_entries, ledger_head, ledger_version TO reader",
    ):
        postgresql.ask(statement, name)
    url = postgresql.url(name)
    writer, reader = (Ledger(url.replace("postgres@", f"{role}@")) for role in ("writer", "reader"))
    writer.require_writable()
    assert writer.append(content(2)).new
    assert not found(reader)
    assert len(list(reader.entries())) == 2
    for refused in (reader.require_writable, lambda: reader.append(content(3))):
        with pytest.raises(OutputError, match="permission denied"):
            refused()
    for statement in ("DROP TRIGGER entries_stay ON ledger_entries", "TRUNCATE ledger_entries"):
        with pytest.raises(Exception, match=r"must be owner|permission denied"):
            tampered(url.replace("postgres@", "writer@"), statement)
    assert ledger.head()[0] == 2


@pytest.mark.slow
def test_a_server_that_goes_away_while_an_entry_is_appended(
    postgresql: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    where = postgresql.create("going")
    ledger = filled(where)
    plain = store.Link.of

    def going(*arguments: Any) -> Any:
        postgresql.stop()
        return plain(*arguments)

    monkeypatch.setattr(store.Link, "of", going)
    try:
        with pytest.raises(OutputError) as error:
            ledger.append(content(6))
        assert "\n" not in str(error.value)
        with pytest.raises(InputError):
            Ledger(where)
    finally:
        postgresql.start()
    monkeypatch.undo()
    assert ledger.head()[0] == 5
    assert ledger.append(content(6)).new
    assert not found(ledger)


@pytest.mark.slow
def test_a_server_that_goes_away_when_it_has_committed(
    postgresql: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    where = postgresql.create("gone")
    ledger = filled(where)
    plain = ledger._append

    def committed(connection: Any, added: Any) -> Any:
        plain(connection, added)
        connection.commit()
        raise OutputError("the server was lost")

    monkeypatch.setattr(ledger, "_append", committed)
    done = ledger.append(content(6))
    assert done.new
    assert done.link.sequence == 6
    assert not found(ledger)
