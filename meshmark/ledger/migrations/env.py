"""Run by Alembic: migrations on the connection that `meshmark.ledger.store` has opened."""

from __future__ import annotations

from alembic import context

from meshmark.ledger.schema import VERSION_TABLE

context.configure(
    connection=context.config.attributes["connection"],
    version_table=VERSION_TABLE,
    transactional_ddl=True,
)
context.run_migrations()
