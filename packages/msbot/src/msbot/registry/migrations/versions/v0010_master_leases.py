"""Who serves a robot that several masters share, and until when."""

import sqlalchemy as sa
from alembic import op

revision = "0010"
down_revision: str | None = "0009"


def upgrade() -> None:
    """Add the table."""
    op.create_table(
        "master_leases",
        sa.Column("robot_id", sa.Integer(), nullable=False),
        sa.Column("epoch", sa.BigInteger(), nullable=False),
        sa.Column("holder", sa.Text(), nullable=False),
        sa.Column("until_ns", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("robot_id", name="pk_master_leases"),
        sa.ForeignKeyConstraint(["robot_id"], ["robots.id"], name="fk_master_leases_robot_id", ondelete="CASCADE"),
    )
