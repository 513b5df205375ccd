"""An analysis may stand in several batches, one that was put back for want of room is counted, and a server
knows its own idempotency keys.
"""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"

_FILL = """
INSERT INTO batch_items (batch_id, place, analysis_id)
SELECT batch_id, row_number() OVER (PARTITION BY batch_id ORDER BY created_at, id) - 1, id
FROM analyses WHERE batch_id IS NOT NULL AND replaced_by IS NULL
"""


def upgrade() -> None:
    """Add what the release of this revision keeps, and say for every batch what is in it."""
    op.add_column("analyses", sa.Column("put_backs", sa.Integer, nullable=False, server_default="0"))
    op.add_column("batches", sa.Column("duplicate_count", sa.Integer, nullable=False, server_default="0"))
    op.add_column("kept_answers", sa.Column("server", sa.String(40), nullable=False, server_default=""))
    op.create_table(
        "batch_items",
        sa.Column("batch_id", sa.String(32), sa.ForeignKey("batches.id"), primary_key=True),
        sa.Column("place", sa.Integer, primary_key=True),
        sa.Column(
            "analysis_id", sa.String(32), sa.ForeignKey("analyses.id", ondelete="CASCADE"), nullable=False
        ),
    )
    op.create_index("ix_batch_items_analysis_id", "batch_items", ["analysis_id"])
    op.execute(_FILL)
