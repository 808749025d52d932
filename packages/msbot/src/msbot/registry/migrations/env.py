"""How Alembic reaches the database: the connection is handed over by `msbot.registry.database.schema`."""

from alembic import context

context.configure(connection=context.config.attributes["connection"])
with context.begin_transaction():
    context.run_migrations()
