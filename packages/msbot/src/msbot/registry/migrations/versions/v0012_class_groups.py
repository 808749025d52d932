"""Groups of a class: which pupils, and which slots are theirs."""

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision: str | None = "0011"


def upgrade() -> None:
    """Add the table."""
    op.create_table(
        "class_groups",
        sa.Column("robot_id", sa.Integer(), nullable=False),
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("group_name", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("robot_id", "kind", "name", name="pk_class_groups"),
        sa.ForeignKeyConstraint(["robot_id"], ["robots.id"], name="fk_class_groups_robot_id", ondelete="CASCADE"),
    )
