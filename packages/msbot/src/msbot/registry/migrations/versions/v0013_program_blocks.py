"""The blocks that programs are made of."""

import sqlalchemy as sa
from alembic import op

revision = "0013"
down_revision: str | None = "0012"


def upgrade() -> None:
    """Add the column."""
    op.add_column("program_texts", sa.Column("blocks", sa.Text(), nullable=False, server_default=""))
