"""Topics that are in DDS for others, too."""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision: str | None = "0005"


def upgrade() -> None:
    """Add the column; robots from before keep to themselves."""
    op.add_column("robots", sa.Column("in_dds", sa.JSON(), nullable=False, server_default="{}"))
