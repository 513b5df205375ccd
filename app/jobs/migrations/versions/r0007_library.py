"""What the library lists, sorts and keeps: the day in short, the method's version, tags, saved views."""

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"


def upgrade() -> None:
    """Add columns and table, empty, and the index by which the newest analysis of a recording is found."""
    op.add_column("answers", sa.Column("method", sa.String(16)))
    op.add_column("answers", sa.Column("method_version", sa.Integer()))
    op.add_column("answers", sa.Column("day", sa.Text()))
    op.add_column("recordings", sa.Column("tags", sa.Text(), nullable=False, server_default="[]"))
    op.create_table(
        "saved_views",
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("query", sa.Text(), nullable=False),
        sa.Column("created_at", sa.String(32), nullable=False),
    )
    op.create_index("analyses_by_recording", "analyses", ["recording_id", "created_at", "id"])
    op.drop_index("ix_analyses_recording_id", table_name="analyses")
