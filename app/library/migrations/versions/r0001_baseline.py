"""The baseline: every table of the code.

Before the first release a change of the tables changes ``REVISION`` of the tables module, and older data
folders are refused. The first migration after the release must first write out these tables.
"""

from alembic import op

from acromion.app.library.database.tables import metadata

revision = "b5"
down_revision = None


def upgrade() -> None:
    """Create every table."""
    metadata.create_all(op.get_bind())
