"""The few figures by which finished analyses are found and listed."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"


def upgrade() -> None:
    """Add what the release of this revision keeps; analyses that are done already are listed without."""
    op.create_table(
        "answers",
        sa.Column(
            "analysis_id", sa.String(32), sa.ForeignKey("analyses.id", ondelete="CASCADE"), primary_key=True
        ),
        sa.Column("verdict", sa.String(16), nullable=False),
        sa.Column("start", sa.String(40)),
        sa.Column("recorded_s", sa.Float()),
        sa.Column("above_60_percent", sa.Float()),
    )
    op.create_index("ix_answers_verdict", "answers", ["verdict"])
