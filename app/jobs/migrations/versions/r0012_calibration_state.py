"""How the calibration pose of a report is known, for the list."""

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"


def upgrade() -> None:
    """Add the column, empty: it is not known of reports of an earlier method."""
    present = {column["name"] for column in sa.inspect(op.get_bind()).get_columns("answers")}
    if "calibration_state" not in present:
        op.add_column("answers", sa.Column("calibration_state", sa.String(16)))
