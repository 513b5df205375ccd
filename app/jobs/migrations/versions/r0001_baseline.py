"""The first tables."""

from alembic import op

from app.jobs.database.tables import metadata

revision = "b1"
down_revision = None


def upgrade() -> None:
    """Create every table."""
    metadata.create_all(op.get_bind())
