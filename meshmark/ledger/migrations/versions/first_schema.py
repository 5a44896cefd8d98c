"""Entries that nobody can alter, and the head that tells the last of them."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "1"
down_revision = None

REFUSAL = "the ledger is append-only"

# `INSERT OR REPLACE` removes rows without asking triggers of DELETE: what is there is not replaced.
SQLITE = (
    f"""CREATE TRIGGER entries_in_order BEFORE INSERT ON ledger_entries
    WHEN NEW.sequence <> 1 + (SELECT coalesce(max(sequence), 0) FROM ledger_entries)
        OR EXISTS (SELECT 1 FROM ledger_entries WHERE record = NEW.record OR hash = NEW.hash)
    BEGIN SELECT RAISE(ABORT, '{REFUSAL}'); END""",
    f"""CREATE TRIGGER entries_stay BEFORE UPDATE ON ledger_entries
    BEGIN SELECT RAISE(ABORT, '{REFUSAL}'); END""",
    f"""CREATE TRIGGER entries_remain BEFORE DELETE ON ledger_entries
    BEGIN SELECT RAISE(ABORT, '{REFUSAL}'); END""",
    f"""CREATE TRIGGER head_is_one BEFORE INSERT ON ledger_head
    BEGIN SELECT RAISE(ABORT, '{REFUSAL}'); END""",
    f"""CREATE TRIGGER head_moves_on BEFORE UPDATE ON ledger_head
    WHEN NEW.id <> OLD.id OR NEW.sequence <> OLD.sequence + 1
    BEGIN SELECT RAISE(ABORT, '{REFUSAL}'); END""",
    f"""CREATE TRIGGER head_remains BEFORE DELETE ON ledger_head
    BEGIN SELECT RAISE(ABORT, '{REFUSAL}'); END""",
)
POSTGRESQL = (
    f"""CREATE FUNCTION meshmark_refuse() RETURNS trigger LANGUAGE plpgsql AS $$
    BEGIN RAISE EXCEPTION '{REFUSAL}'; END $$""",
    f"""CREATE FUNCTION meshmark_in_order() RETURNS trigger LANGUAGE plpgsql AS $$
    BEGIN
        IF NEW.sequence <> 1 + (SELECT coalesce(max(sequence), 0) FROM ledger_entries) THEN
            RAISE EXCEPTION '{REFUSAL}';
        END IF;
        RETURN NEW;
    END $$""",
    f"""CREATE FUNCTION meshmark_moves_on() RETURNS trigger LANGUAGE plpgsql AS $$
    BEGIN
        IF NEW.id <> OLD.id OR NEW.sequence <> OLD.sequence + 1 THEN
            RAISE EXCEPTION '{REFUSAL}';
        END IF;
        RETURN NEW;
    END $$""",
    """CREATE TRIGGER entries_in_order BEFORE INSERT ON ledger_entries
    FOR EACH ROW EXECUTE FUNCTION meshmark_in_order()""",
    """CREATE TRIGGER entries_stay BEFORE UPDATE OR DELETE ON ledger_entries
    FOR EACH ROW EXECUTE FUNCTION meshmark_refuse()""",
    """CREATE TRIGGER entries_remain BEFORE TRUNCATE ON ledger_entries
    FOR EACH STATEMENT EXECUTE FUNCTION meshmark_refuse()""",
    """CREATE TRIGGER head_moves_on BEFORE UPDATE ON ledger_head
    FOR EACH ROW EXECUTE FUNCTION meshmark_moves_on()""",
    """CREATE TRIGGER head_is_one BEFORE INSERT OR DELETE ON ledger_head
    FOR EACH ROW EXECUTE FUNCTION meshmark_refuse()""",
    """CREATE TRIGGER head_remains BEFORE TRUNCATE ON ledger_head
    FOR EACH STATEMENT EXECUTE FUNCTION meshmark_refuse()""",
)


def upgrade() -> None:
    """Make tables and triggers."""
    op.create_table(
        "ledger_entries",
        sa.Column("sequence", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("kind", sa.String, nullable=False),
        sa.Column("asset", sa.String, index=True),
        sa.Column("version", sa.String),
        sa.Column("recipient", sa.String, index=True),
        sa.Column("key_id", sa.String, index=True),
        sa.Column("record", sa.String, nullable=False, unique=True),
        sa.Column("body", sa.Text, nullable=False),
        sa.Column("previous", sa.String, nullable=False),
        sa.Column("hash", sa.String, nullable=False, unique=True),
    )
    op.create_table(
        "ledger_head",
        sa.Column("id", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("sequence", sa.Integer, nullable=False),
        sa.Column("hash", sa.String, nullable=False),
    )
    op.execute(f"INSERT INTO ledger_head VALUES (1, 0, '{'0' * 64}')")
    dialect = op.get_bind().dialect.name
    for statement in SQLITE if dialect == "sqlite" else POSTGRESQL:
        op.execute(statement)
