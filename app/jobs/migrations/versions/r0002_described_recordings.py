"""Recordings described and filed, uploads that resume, batches, webhooks, analyses in turn."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"


def upgrade() -> None:
    """Add what the release of this revision keeps."""
    _change_batches()
    _change_kept_answers()
    _change_uploads()
    _change_webhooks()
    _change_deliveries()
    _change_analyses()
    _change_recordings()


def _change_batches() -> None:
    op.create_table(
        "batches",
        sa.Column("id", sa.String(32), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("item_count", sa.Integer(), nullable=False),
        sa.Column("created_at", sa.String(32), nullable=False),
        sa.PrimaryKeyConstraint("id"),
    )


def _change_kept_answers() -> None:
    op.create_table(
        "kept_answers",
        sa.Column("key", sa.String(64), nullable=False),
        sa.Column("fingerprint", sa.String(64), nullable=False),
        sa.Column("status", sa.Integer()),
        sa.Column("headers", sa.Text()),
        sa.Column("body", sa.LargeBinary()),
        sa.Column("age_s", sa.Float(), nullable=False),
        sa.PrimaryKeyConstraint("key"),
    )


def _change_uploads() -> None:
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


def _change_webhooks() -> None:
    op.create_table(
        "webhooks",
        sa.Column("id", sa.String(32), nullable=False),
        sa.Column("url", sa.Text(), nullable=False),
        sa.Column("events", sa.Text(), nullable=False),
        sa.Column("secret", sa.String(64), nullable=False),
        sa.Column("created_at", sa.String(32), nullable=False),
        sa.PrimaryKeyConstraint("id"),
    )


def _change_deliveries() -> None:
    op.create_table(
        "deliveries",
        sa.Column("id", sa.String(32), nullable=False),
        sa.Column("webhook_id", sa.String(32), nullable=False),
        sa.Column("event", sa.String(32), nullable=False),
        sa.Column("body", sa.Text(), nullable=False),
        sa.Column("tries", sa.Integer(), nullable=False),
        sa.Column("wait_s", sa.Float(), nullable=False),
        sa.ForeignKeyConstraint(
            ["webhook_id"],
            ["webhooks.id"],
        ),
        sa.PrimaryKeyConstraint("id"),
    )
    with op.batch_alter_table("deliveries") as batch_op:
        batch_op.create_index("ix_deliveries_webhook_id", ["webhook_id"])


def _change_analyses() -> None:
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


def _change_recordings() -> None:
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
        batch_op.create_index("recordings_by_external_id", ["state", "external_id", "created_at", "id"])
        batch_op.create_index("recordings_by_start", ["state", "start", "id"])
        batch_op.create_index("recordings_by_subject", ["state", "subject", "created_at", "id"])
