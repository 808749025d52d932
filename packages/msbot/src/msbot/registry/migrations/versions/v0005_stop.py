"""Store STOP with its robot, so that it still holds after a restart and on another computer."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision: str | None = "0004"


def upgrade() -> None:
    """Add the column; in existing robots nobody has said STOP."""
    op.add_column("robots", sa.Column("stop", sa.JSON(), nullable=True))
