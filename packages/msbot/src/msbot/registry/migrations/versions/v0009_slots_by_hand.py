"""Who made a slot: the blueprint, or a person on the page."""

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision: str | None = "0008"


def upgrade() -> None:
    """Add the column; existing slots count as the blueprint's."""
    op.add_column("slots", sa.Column("origin", sa.Text(), nullable=False, server_default="blueprint"))
