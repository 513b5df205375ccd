"""Words of people are sealed: no index searches them, and what awaits columns has a column of its own."""

import json

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"


def upgrade() -> None:
    """Add the column, filled from the refusals; the words are sealed afterwards, while the server runs."""
    op.add_column("analyses", sa.Column("awaits", sa.String(64)))
    op.create_index("analyses_by_awaited", "analyses", ["awaits"])
    op.create_index("recordings_by_revision", "recordings", ["id", "revision"])
    op.drop_index("recordings_by_subject", table_name="recordings")
    op.drop_index("recordings_by_external_id", table_name="recordings")
    rows = sa.table("analyses", sa.column("id"), sa.column("problem_facts"), sa.column("awaits"))
    connection = op.get_bind()
    refused = sa.select(rows.c.id, rows.c.problem_facts).where(rows.c.problem_facts.like('%"header"%'))
    for row in connection.execute(refused).all():
        change = sa.update(rows).where(rows.c.id == row.id)
        connection.execute(change.values(awaits=json.loads(row.problem_facts).get("header")))
