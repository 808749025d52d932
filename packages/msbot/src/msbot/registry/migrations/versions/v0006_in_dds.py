"""Store which topics are also shared with others over DDS."""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision: str | None = "0005"


def upgrade() -> None:
    """Add the column; existing robots share no topics."""
    op.add_column("robots", sa.Column("in_dds", sa.JSON(), nullable=False, server_default="{}"))
