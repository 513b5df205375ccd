"""The script that Alembic runs: the migrations, in the transaction of :mod:`app.library.migrations`."""

from alembic import context

from app.library.database.tables import metadata

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=metadata,
    render_as_batch=True,
    include_name=lambda name, *_: not str(name).startswith("procrastinate_"),
)
with context.begin_transaction():
    context.run_migrations()
