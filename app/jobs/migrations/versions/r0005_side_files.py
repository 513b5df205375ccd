"""A recording counts its changes and those in its side file; an analysis counts the ends of its host."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"


def upgrade() -> None:
    """Add the counters; every side file is still to be written."""
    for name, first in (("revision", "1"), ("side_revision", "0")):
        op.add_column("recordings", sa.Column(name, sa.Integer, nullable=False, server_default=first))
    op.add_column("analyses", sa.Column("interruptions", sa.Integer, nullable=False, server_default="0"))
