"""Databases a ledger can be in: a file of SQLite, or a server's, by psycopg."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from sqlalchemy import Connection, Engine, NullPool, create_engine, event, make_url
from sqlalchemy.exc import ArgumentError, DBAPIError

from meshmark.errors import InputError, MeshmarkError, OutputError, UsageError
from meshmark.ledger.extra import require_installed

# Seconds that a writer waits for the others, and anybody for a server.
PATIENCE, TO_CONNECT = 120, 10
FORMS = "a file, sqlite:///FILE or postgresql://USER@HOST/NAME"
# Names the lock of those who make a ledger on a server, where there is no table yet: "meshmark".
MAKERS = int.from_bytes(b"meshmark")
# Execution option of connections that will append.
WRITING = "meshmark_writing"


@dataclass(frozen=True)
class Database:
    """A database, not yet connected to.

    Parameters
    ----------
    name : str
        What it is called in messages; no password is in it.
    engine : Engine
    missing : bool
        Whether it is a file that is not there, and is not to be made.
    """

    name: str
    engine: Engine
    missing: bool = False

    @contextmanager
    def reading(self) -> Iterator[Connection]:
        """Open a transaction that reads.

        Raises
        ------
        InputError
            If the database is not there, cannot be read, or goes away.
        """
        self._require_there()
        with self._errors_as(InputError), self.engine.begin() as connection:
            yield connection

    @contextmanager
    def writing(self, lock: str | None = None) -> Iterator[Connection]:
        """Open a transaction that no other writer is in; what is raised within undoes it.

        Parameters
        ----------
        lock : str, optional
            The table that writers of a server lock, if it is there by now; of a file, all is
            locked.

        Raises
        ------
        OutputError
            If the database is not there, cannot be written to, or goes away.
        """
        self._require_there()
        engine = self.engine.execution_options(**{WRITING: True})
        with self._errors_as(OutputError), engine.begin() as connection:
            if engine.dialect.name == "postgresql":
                connection.exec_driver_sql(f"SET LOCAL lock_timeout = '{PATIENCE}s'")
                if lock is None:
                    connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({MAKERS})")
                else:
                    # Readers are let in.
                    connection.exec_driver_sql(f"LOCK TABLE {lock} IN EXCLUSIVE MODE")
            yield connection

    def _require_there(self) -> None:
        if self.missing:
            raise InputError(
                "there is no ledger; make one with `meshmark ledger init`", source=self.name
            )

    @contextmanager
    def _errors_as(self, kind: type[MeshmarkError]) -> Iterator[None]:
        try:
            yield
        except DBAPIError as error:
            raise kind(_in_one_line(error), source=self.name) from None


def database(text: str, *, create: bool = False) -> Database:
    """Find the database that `--ledger` names.

    Parameters
    ----------
    text : str
        One of `FORMS`.
    create : bool
        Whether a file that is missing is made once somebody connects.

    Raises
    ------
    UsageError
        If it is none of them, or what is needed to reach it is not installed.
    """
    if "://" not in text:
        return _file(Path(text), create)
    # What was typed may hold a password: it is not repeated.
    refusal = UsageError(f"--ledger takes {FORMS}")
    try:
        url = make_url(text)
    except (ArgumentError, ValueError):
        raise refusal from None
    backend, _, driver = url.drivername.partition("+")
    if backend == "sqlite" and not driver and url.database and not url.query:
        return _file(Path(url.database), create)
    if backend not in ("postgresql", "postgres") or driver not in ("", "psycopg"):
        raise refusal
    require_installed("psycopg")
    engine = create_engine(
        url.set(drivername="postgresql+psycopg"),
        poolclass=NullPool,
        connect_args={"connect_timeout": TO_CONNECT, "client_encoding": "utf8"},
    )
    place = f"{url.host or ''}:{url.port}" if url.port else url.host or ""
    return Database(f"postgresql://{place}/{url.database or ''}", engine)


def _file(path: Path, create: bool) -> Database:
    if not path.name:
        raise UsageError(f"--ledger takes {FORMS}")
    engine = create_engine("sqlite://", creator=_opener(path, create), poolclass=NullPool)

    @event.listens_for(engine, "begin")
    def _begin(connection: Connection) -> None:
        writing = connection.get_execution_options().get(WRITING)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writing else "BEGIN")

    return Database(str(path), engine, missing=not create and not path.is_file())


def _opener(path: Path, create: bool) -> Callable[[], Any]:
    uri = f"file:{quote(str(path.absolute()))}?mode={'rwc' if create else 'rw'}"

    def opened() -> sqlite3.Connection:
        # Transactions are begun by hand, so that the definition of tables is part of them.
        connection = sqlite3.connect(
            uri, uri=True, timeout=PATIENCE, isolation_level=None, check_same_thread=False
        )
        # A damaged entry is to be named, not to end the reading.
        connection.text_factory = lambda data: data.decode("utf-8", "surrogateescape")
        connection.execute("PRAGMA synchronous = FULL")
        return connection

    return opened


def _in_one_line(error: DBAPIError) -> str:
    said = str(error.orig).strip().partition("\n")[0]
    return " ".join(said.split()) or type(error.orig).__name__
