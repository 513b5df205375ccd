"""Who did what: the trail, who asked, releases, holds, retention, published group figures.

What is there goes to the organisation "own", which this database is: the trail begins with a line that says
so.
"""

import sqlalchemy as sa
from alembic import op

from app.jobs.trail import AT_MACHINE, record

revision = "0008"
down_revision = "0007"


def upgrade() -> None:
    """Add tables and columns, empty, and begin the trail."""
    op.add_column("recordings", sa.Column("since_s", sa.Float(), nullable=False, server_default="0"))
    op.add_column("recordings", sa.Column("hold", sa.String(32)))
    op.add_column("recordings", sa.Column("hold_by", sa.String(40)))
    op.add_column("analyses", sa.Column("asked_by", sa.String(40)))
    op.add_column("analyses", sa.Column("ended_s", sa.Float()))
    _create_trail()
    _create_rules()
    _create_aggregate()
    connection = op.get_bind()
    number = connection.execute(sa.text("SELECT count(*) FROM recordings")).scalar_one()
    known: dict[str, str | int] = {"organisation": "own", "recordings": int(number)}
    known |= {"revision": down_revision}
    record(connection, "trail.began", other=known, who=AT_MACHINE)


def _create_trail() -> None:
    op.create_table(
        "trail",
        sa.Column("seq", sa.BigInteger(), primary_key=True, autoincrement=False),
        sa.Column("at", sa.String(32), nullable=False),
        sa.Column("who", sa.String(40), nullable=False),
        sa.Column("act", sa.String(32), nullable=False),
        sa.Column("recording_id", sa.String(32), nullable=False),
        sa.Column("analysis_id", sa.String(32), nullable=False),
        sa.Column("other", sa.Text(), nullable=False),
        sa.Column("prev", sa.String(64), nullable=False),
        sa.Column("hash", sa.String(64), nullable=False),
    )
    op.create_index("trail_by_recording", "trail", ["recording_id", "seq"])
    op.create_index("trail_by_who", "trail", ["who", "seq"])
    op.create_table(
        "trail_marks",
        sa.Column("seq", sa.BigInteger(), primary_key=True, autoincrement=False),
        sa.Column("since_s", sa.Float(), nullable=False),
    )


def _create_rules() -> None:
    op.create_table(
        "running_time",
        sa.Column("id", sa.Integer(), primary_key=True, autoincrement=False),
        sa.Column("running_s", sa.Float(), nullable=False),
    )
    op.create_table(
        "releases",
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column(
            "analysis_id", sa.String(32), sa.ForeignKey("analyses.id", ondelete="CASCADE"), nullable=False
        ),
        sa.Column("who", sa.String(40), nullable=False),
        sa.Column("at", sa.String(32), nullable=False),
        sa.Column("method_version", sa.String(16), nullable=False),
        sa.Column("report_id", sa.String(64), nullable=False),
        sa.Column("is_taken_back", sa.Integer(), nullable=False, server_default="0"),
    )
    op.create_index("ix_releases_analysis_id", "releases", ["analysis_id"])
    op.create_table(
        "retention",
        sa.Column("kind", sa.String(16), primary_key=True),
        sa.Column("days", sa.Integer(), nullable=False),
    )


def _create_aggregate() -> None:
    op.create_table(
        "aggregate_blocks",
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column("study_id", sa.String(32), nullable=False),
        sa.Column("published_at", sa.String(32), nullable=False),
        sa.Column("figures", sa.Text(), nullable=False),
    )
    op.create_index("ix_aggregate_blocks_study_id", "aggregate_blocks", ["study_id"])
    op.create_table(
        "aggregate_members",
        sa.Column(
            "recording_id",
            sa.String(32),
            sa.ForeignKey("recordings.id", ondelete="CASCADE"),
            primary_key=True,
        ),
        sa.Column("block_id", sa.String(32), sa.ForeignKey("aggregate_blocks.id"), nullable=False),
    )
    op.create_index("ix_aggregate_members_block_id", "aggregate_members", ["block_id"])
