"""Digests that rows are found by are keyed: a plain one confirms a guessed name."""

import sqlalchemy as sa
from alembic import op

from app.jobs.database.sealed_text import find_sealer
from app.storage.labels import DIGEST_MARK

revision = "0011"
down_revision = "0010"

ROWS_AT_ONCE = 1000


def upgrade() -> None:
    """Replace each digest by its keyed one; what was asked for need not be known for it."""
    _key_column("analyses", "id", "key")
    _key_column("kept_answers", "key", "fingerprint")
    _key_column("kept_answers", "key", "key")
    _key_column("analyses", "id", "awaits")
    with op.batch_alter_table("column_mappings") as batch_op:
        batch_op.alter_column("header", existing_type=sa.String(32), type_=sa.String(64))
    _key_column("column_mappings", "header", "header")


def _key_column(table: str, primary_key: str, name: str) -> None:
    """Key the digests of a column, so many rows at once, in the order of their primary key."""
    rows = sa.table(table, *(sa.column(one, sa.Text) for one in dict.fromkeys((primary_key, name))))
    row_id, column, last = rows.c[primary_key], rows.c[name], ""
    is_plain = sa.and_(column != "", ~column.startswith(DIGEST_MARK), ~column.startswith(f"-{DIGEST_MARK}"))
    connection = op.get_bind()
    change = sa.update(rows).where(row_id == sa.bindparam("row_id")).values({name: sa.bindparam("keyed")})
    while True:
        query = sa.select(row_id, column).where(row_id > last, is_plain).order_by(row_id).limit(ROWS_AT_ONCE)
        found = connection.execute(query).all()
        if not found:
            return
        sealer, last = find_sealer(connection.engine), found[-1][0]
        keyed = [{"row_id": row[0], "keyed": sealer.key_digest(row[1])} for row in found]
        connection.execute(change, keyed)
