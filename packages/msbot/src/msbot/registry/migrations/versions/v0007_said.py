"""Store the sentences of the journal and of the edits with their values, so that pages can translate them."""

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision: str | None = "0006"


def upgrade() -> None:
    """Add the columns; older lines stay as they are, in English."""
    op.add_column("journal", sa.Column("said", sa.JSON(), nullable=True))
    op.add_column("edits", sa.Column("said", sa.JSON(), nullable=True))
