"""The tables of a ledger, as the newest migration leaves them."""

from __future__ import annotations

from sqlalchemy import Column, Integer, MetaData, String, Table, Text

# The newest of `migrations/versions`.
REVISION = "1"
# Where Alembic keeps which of them a database has; other programs may use the same database.
VERSION_TABLE = "ledger_version"

metadata = MetaData()

entries = Table(
    "ledger_entries",
    metadata,
    Column("sequence", Integer, primary_key=True, autoincrement=False),
    Column("kind", String, nullable=False),
    Column("asset", String, index=True),
    Column("version", String),
    Column("recipient", String, index=True),
    Column("key_id", String, index=True),
    Column("record", String, nullable=False, unique=True),
    Column("body", Text, nullable=False),
    Column("previous", String, nullable=False),
    Column("hash", String, nullable=False, unique=True),
)

# One row: the last entry. Without it, nobody could tell that the last ones are missing.
head = Table(
    "ledger_head",
    metadata,
    Column("id", Integer, primary_key=True, autoincrement=False),
    Column("sequence", Integer, nullable=False),
    Column("hash", String, nullable=False),
)
