"""What a purge takes along in other tables: kept answers that speak of the recording, and empty batches."""

from collections.abc import Collection

from sqlalchemy import Connection, delete, exists, select

from app.jobs.kept_answers import empty_answers
from app.jobs.tables import batch_items, batches


def drop_traces(connection: Connection, ids: Collection[str]) -> None:
    """Leave no word of purged recordings and analyses; ``ids`` are theirs.

    For the transaction that deletes their rows, after them: a batch is empty only then, and an answer that
    is kept at the same time has either been committed or sees that the rows are gone.
    """
    no_item = ~exists().where(batch_items.c.batch_id == batches.c.id)
    empty = tuple(connection.execute(select(batches.c.id).where(no_item)).scalars())
    if empty:
        connection.execute(delete(batches).where(batches.c.id.in_(empty), no_item))
    empty_answers(connection, {*ids, *empty})
