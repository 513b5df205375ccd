"""The script with which Alembic migrates, in the transaction of :mod:`acromion.app.library.migrations`."""

from alembic import context

from acromion.app.library.database.tables import metadata

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=metadata,
    render_as_batch=True,
    include_name=lambda name, *_: not str(name).startswith("procrastinate_"),
)
with context.begin_transaction():
    context.run_migrations()
