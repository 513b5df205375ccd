"""Recordings described and filed, uploads that resume, analyses in turn and without a double."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"


def upgrade() -> None:
    """Add what the release of this revision keeps."""
    op.create_table(
        "uploads",
        sa.Column("id", sa.String(32), nullable=False),
        sa.Column("length_bytes", sa.BigInteger(), nullable=False),
        sa.Column("offset_bytes", sa.BigInteger(), nullable=False),
        sa.Column("metadata", sa.Text(), nullable=False),
        sa.Column("description", sa.Text(), nullable=False),
        sa.Column("idle_s", sa.Float(), nullable=False),
        sa.Column("recording_id", sa.String(32)),
        sa.Column("created_at", sa.String(32), nullable=False),
        sa.PrimaryKeyConstraint("id"),
    )
    with op.batch_alter_table("analyses") as batch_op:
        batch_op.add_column(sa.Column("key", sa.String(64)))
        batch_op.add_column(sa.Column("priority", sa.Integer(), server_default="1", nullable=False))
        batch_op.add_column(sa.Column("turn", sa.Integer(), server_default="0", nullable=False))
        batch_op.add_column(sa.Column("batch_id", sa.String(32)))
        batch_op.add_column(sa.Column("replaced_by", sa.String(32)))
        batch_op.drop_index("analyses_by_age")
        batch_op.create_index("analyses_by_age", ["created_at", "id"])
        batch_op.drop_index("analyses_by_state")
        batch_op.create_index("analyses_by_state", ["state", "created_at", "id"])
        batch_op.create_index("analyses_by_flow", ["batch_id", "state", "turn"])
        batch_op.create_index("analyses_by_key", ["key"])
        batch_op.create_index("analyses_in_turn", ["state", "priority", "turn", "created_at", "id"])

    with op.batch_alter_table("recordings") as batch_op:
        batch_op.add_column(sa.Column("subject", sa.Text(), server_default="", nullable=False))
        batch_op.add_column(sa.Column("side", sa.String(8)))
        batch_op.add_column(sa.Column("external_id", sa.Text(), server_default="", nullable=False))
        batch_op.add_column(sa.Column("note", sa.Text(), server_default="", nullable=False))
        batch_op.add_column(sa.Column("duplicate_of", sa.String(32)))
        batch_op.add_column(sa.Column("version", sa.Integer(), server_default="1", nullable=False))
        batch_op.add_column(sa.Column("start", sa.String(40)))
        batch_op.add_column(sa.Column("inspection", sa.Text()))
        batch_op.add_column(sa.Column("diary", sa.Text(), server_default="[]", nullable=False))
        batch_op.add_column(sa.Column("trashed_s", sa.Float()))
        batch_op.create_index("recordings_by_age", ["state", "created_at", "id"])
        batch_op.create_index("recordings_by_external_id", ["external_id", "created_at", "id"])
        batch_op.create_index("recordings_by_start", ["start"])
        batch_op.create_index("recordings_by_subject", ["subject", "created_at", "id"])
