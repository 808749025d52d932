"""Store whether parts must prove that they know their key, like the blueprint's other options."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision: str | None = "0002"


def upgrade() -> None:
    """Add the column; existing robots let parts in without a proof."""
    op.add_column("robots", sa.Column("authentication", sa.Text(), nullable=False, server_default="open"))
