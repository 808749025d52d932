"""Store which versions of a part an entry of the library describes."""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision: str | None = "0003"


def upgrade() -> None:
    """Add the column; existing entries describe every version."""
    op.add_column("library", sa.Column("versions", sa.Text(), nullable=False, server_default=""))
