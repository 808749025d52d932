"""What people change: edits that can be undone, who set a value, wires made by hand, users, and keys of parts."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision: str | None = "0001"


def upgrade() -> None:
    """Add columns to bindings and settings, then the new tables."""
    op.add_column("bindings", sa.Column("origin", sa.Text(), nullable=False, server_default="blueprint"))
    op.add_column("bindings", sa.Column("in_use", sa.Boolean(), nullable=False, server_default=sa.true()))
    op.add_column("settings", sa.Column("who", sa.Text(), nullable=False, server_default=""))
    with op.batch_alter_table("parts") as parts:
        parts.add_column(sa.Column("placed_slot_id", sa.Integer(), nullable=True))
        parts.create_foreign_key("fk_parts_placed_slot_id", "slots", ["placed_slot_id"], ["id"], ondelete="SET NULL")
    _edits()
    _users()
    _keys()


def _edits() -> None:
    number = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
    op.create_table(
        "edits",
        sa.Column("id", number, nullable=False),
        sa.Column("robot_id", sa.Integer(), nullable=True),
        sa.Column("at_ns", sa.BigInteger(), nullable=False),
        sa.Column("who", sa.Text(), nullable=False),
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("slot", sa.Text(), nullable=False),
        sa.Column("words", sa.Text(), nullable=False),
        sa.Column("before", sa.JSON(), nullable=False),
        sa.Column("after", sa.JSON(), nullable=False),
        sa.Column("undone_by", number, nullable=True),
        sa.ForeignKeyConstraint(["robot_id"], ["robots.id"], name="fk_edits_robot_id", ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("id", name="pk_edits"),
    )
    op.create_index("ix_edits_robot_id", "edits", ["robot_id", "id"], unique=False)


def _users() -> None:
    op.create_table(
        "users",
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("role", sa.Text(), nullable=False),
        sa.Column("password_hash", sa.Text(), nullable=False),
        sa.Column("token_hashes", sa.JSON(), nullable=False),
        sa.Column("created_ns", sa.BigInteger(), nullable=False),
        sa.Column("changed_ns", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("name", name="pk_users"),
    )


def _keys() -> None:
    op.create_table(
        "keys",
        sa.Column("uid", sa.Text(), nullable=False),
        sa.Column("key", sa.LargeBinary(), nullable=False),
        sa.Column("created_ns", sa.BigInteger(), nullable=False),
        sa.Column("created_by", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("uid", name="pk_keys"),
    )
