"""A webhook's address and secret are sealed, and what is sealed is longer."""

import sqlalchemy as sa
from alembic import op

revision = "0010"
down_revision = "0009"


def upgrade() -> None:
    """Give the secret a column without a limit; both are sealed afterwards, while the server runs."""
    op.add_column("webhooks", sa.Column("longer", sa.Text, nullable=False, server_default=""))
    op.execute("UPDATE webhooks SET longer = secret")
    op.drop_column("webhooks", "secret")
    op.execute("ALTER TABLE webhooks RENAME COLUMN longer TO secret")
