"""The ledger in its database: entries are appended and read, never altered."""

from __future__ import annotations

import getpass
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Row, false, inspect, select, text, update

from meshmark.errors import InputError, MeshmarkError, OutputError
from meshmark.ledger.chain import INDEXED, Finding, Link, findings, record_of
from meshmark.ledger.database import database
from meshmark.ledger.schema import REVISION, VERSION_TABLE, entries, head

# Entries that are read at a time.
CHUNK = 256
# The clocks of two machines differ by no more, in seconds.
SKEW = 60.0
MIGRATIONS = Path(__file__).with_name("migrations")
_COLUMNS = (*INDEXED, "record")


@dataclass(frozen=True)
class Appended:
    """What became of an entry that was to be appended.

    Parameters
    ----------
    link : Link
        The entry; where it was there before, that one.
    new : bool
        Whether it was not.
    behind : float
        Seconds by which this clock is behind that of the entry before, if they are more than
        two clocks differ by; else 0.
    """

    link: Link
    new: bool
    behind: float = 0.0


class Ledger:
    """A ledger that is there and has the newest schema.

    Parameters
    ----------
    where : str
        A file, or a URL; see `meshmark.ledger.database.database`.

    Raises
    ------
    UsageError
        If it names no database, or what is needed to reach it is not installed.
    InputError
        If it is not there, cannot be reached, is no ledger, or has another schema.
    """

    def __init__(self, where: str) -> None:
        self._database = database(where)
        self.name = self._database.name
        with self._database.reading() as connection:
            _require_newest(connection, self.name)

    def require_writable(self) -> None:
        """Take the place of a writer for a moment.

        Raises
        ------
        OutputError
            If that cannot be had.
        """
        with self._appending() as connection:
            connection.execute(update(head).values(id=head.c.id).where(false()))

    def append(self, content: Mapping[str, Any]) -> Appended:
        """Append what is to be recorded, unless it is there already.

        Parameters
        ----------
        content : mapping
            JSON values; when and by whom it is recorded is added.

        Raises
        ------
        OutputError
            If it cannot be appended, or the end of the chain is damaged. Then nothing was, unless
            a server was lost at the very end and is not there to be asked.
        """
        record = record_of(content)
        try:
            with self._appending() as connection:
                known = _find(connection, record)
                return Appended(known, new=False) if known else self._append(connection, content)
        except MeshmarkError:
            # A server that went away may have done it all the same.
            known = self._found_after_all(record)
            if known is None:
                raise
            return Appended(known, new=True)

    def entries(self, **wanted: str | None) -> Iterator[dict[str, Any]]:
        """Read entries by sequence, those whose columns have the values that are wanted.

        Raises
        ------
        InputError
            If they cannot be read, or one was changed.
        """
        for link in self.links(**wanted):
            yield self._entry(link)

    def entry(self, sequence: int) -> dict[str, Any]:
        """Read one entry.

        Raises
        ------
        InputError
            If there is none of that number, or it was changed.
        """
        return self._entry(self.link(sequence))

    def links(self, **wanted: str | None) -> Iterator[Link]:
        """Read entries as they are kept, changed or not; see `entries`."""
        chosen = [entries.c[name] == value for name, value in wanted.items() if value is not None]
        query = select(entries).where(*chosen).order_by(entries.c.sequence)
        with self._database.reading() as connection:
            for row in connection.execution_options(yield_per=CHUNK).execute(query):
                yield _link(row)

    def link(self, sequence: int) -> Link:
        """Read one entry as it is kept, changed or not.

        Raises
        ------
        InputError
            If there is none of that number.
        """
        query = select(entries).where(entries.c.sequence == sequence)
        with self._database.reading() as connection:
            row = connection.execute(query).one_or_none()
        if row is None:
            raise InputError(f"there is no entry {sequence}", source=self.name)
        return _link(row)

    def with_hash(self, hash_: str, source: object) -> Link:
        """Find the entry of a hash, which is from some source.

        Raises
        ------
        InputError
            If there is none.
        """
        query = select(entries).where(entries.c.hash == hash_)
        with self._database.reading() as connection:
            row = connection.execute(query).one_or_none()
        if row is None:
            raise InputError(f"is about no entry of {self.name}", source=source)
        return _link(row)

    def head(self) -> tuple[int, str]:
        """Return sequence and hash of the last entry; 0 and zeros if there is none."""
        with self._database.reading() as connection:
            return _head(connection, self.name)

    def findings(self) -> Iterator[Finding]:
        """Check the chain; see `meshmark.ledger.chain.findings`."""
        last = self.head()
        # What is appended from now on is for the next check.
        yield from findings((link for link in self.links() if link.sequence <= last[0]), last)

    def _entry(self, link: Link) -> dict[str, Any]:
        if not link.whole:
            raise InputError(
                f"entry {link.sequence} was changed: see `meshmark ledger verify`",
                source=self.name,
            )
        return link.entry

    @contextmanager
    def _appending(self) -> Iterator[Connection]:
        with self._database.writing(lock=head.name) as connection:
            # Whatever is asked here, all other writers wait for.
            if (found := _version(connection)) != REVISION:
                raise _of_another(found, self.name)
            yield connection

    def _append(self, connection: Connection, content: Mapping[str, Any]) -> Appended:
        sequence, previous = _head(connection, self.name)
        last = connection.execute(
            select(entries).order_by(entries.c.sequence.desc()).limit(1)
        ).one_or_none()
        if not _is_last(last, sequence, previous):
            raise OutputError(
                "the end of the chain is damaged: see `meshmark ledger verify`", source=self.name
            )
        now = datetime.now(UTC)
        entry = {
            **content,
            "sequence": sequence + 1,
            "recorded_at": now.isoformat(timespec="microseconds"),
            "recorded_by": _user(),
        }
        link = Link.of(entry, previous)
        connection.execute(entries.insert().values(_row(link)))
        connection.execute(update(head).values(sequence=link.sequence, hash=link.hash))
        behind = 0.0
        if last is not None:
            before = datetime.fromisoformat(_link(last).entry["recorded_at"])
            behind = (before - now).total_seconds()
        return Appended(link, new=True, behind=behind if behind > SKEW else 0.0)

    def _found_after_all(self, record: str) -> Link | None:
        try:
            with self._database.reading() as connection:
                return _find(connection, record)
        except MeshmarkError:
            return None


def init(where: str) -> tuple[str, str | None]:
    """Make a ledger, or bring an older one to the newest schema.

    Returns
    -------
    (str, str or None)
        Its name, and the schema it had before.

    Raises
    ------
    UsageError
        If it names no database, or what is needed to reach it is not installed.
    InputError
        If a newer version of meshmark has made it.
    OutputError
        If it cannot be made.
    """
    from alembic import command
    from alembic.config import Config

    place = database(where, create=True)
    with place.writing() as connection:
        before = _revision(connection)
        if before is not None and before not in _revisions():
            raise _of_another(before, place.name)
        config = Config(attributes={"connection": connection})
        config.set_main_option("script_location", str(MIGRATIONS).replace("%", "%%"))
        command.upgrade(config, "head")
    return place.name, before


def _revisions() -> list[str]:
    from alembic.script import ScriptDirectory

    return [script.revision for script in ScriptDirectory(str(MIGRATIONS)).walk_revisions()]


def _revision(connection: Connection) -> str | None:
    return _version(connection) if inspect(connection).has_table(VERSION_TABLE) else None


def _version(connection: Connection) -> str | None:
    found = connection.execute(text(f"SELECT version_num FROM {VERSION_TABLE}")).scalar()
    return None if found is None else str(found)


def _require_newest(connection: Connection, name: str) -> None:
    found = _revision(connection)
    if found is None:
        raise InputError("is no ledger; make one with `meshmark ledger init`", source=name)
    if found != REVISION:
        raise _of_another(found, name)


def _of_another(found: str | None, name: str) -> InputError:
    if found in _revisions():
        return InputError(
            f"has the older schema {found}; `meshmark ledger init` brings it to {REVISION}",
            source=name,
        )
    return InputError(
        f"has the schema {found} of a newer meshmark; this one knows {REVISION}", source=name
    )


def _head(connection: Connection, name: str) -> tuple[int, str]:
    row = connection.execute(select(head.c.sequence, head.c.hash)).one_or_none()
    if row is None:
        raise InputError("is damaged: nothing tells its last entry", source=name)
    return row.sequence, row.hash


def _is_last(row: Row[Any] | None, sequence: int, hash_: str) -> bool:
    """Tell whether the last row is the entry that the head tells of, unchanged."""
    if row is None:
        return sequence == 0
    return (row.sequence, row.hash) == (sequence, hash_) and _link(row).whole


def _find(connection: Connection, record: str) -> Link | None:
    row = connection.execute(select(entries).where(entries.c.record == record)).one_or_none()
    return None if row is None else _link(row)


def _link(row: Row[Any]) -> Link:
    indexed = {name: row._mapping[name] for name in _COLUMNS}
    return Link(row.sequence, row.body, row.previous, row.hash, indexed)


def _row(link: Link) -> dict[str, Any]:
    return {
        "sequence": link.sequence,
        "body": link.body,
        "previous": link.previous,
        "hash": link.hash,
        **link.indexed,
    }


def _user() -> str | None:
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        # Whoever runs has a number only.
        return None
