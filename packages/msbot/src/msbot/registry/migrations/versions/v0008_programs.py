"""Programs that people write on the page, with their versions."""

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision: str | None = "0007"


def upgrade() -> None:
    """Add the two tables."""
    number = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
    op.create_table(
        "programs",
        sa.Column("id", number, nullable=False),
        sa.Column("owner", sa.Text(), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("share", sa.Text(), nullable=False),
        sa.Column("changed_ns", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_programs"),
        sa.UniqueConstraint("owner", "name", name="uq_programs_owner"),
    )
    op.create_index("ix_programs_share", "programs", ["share"], unique=False)
    op.create_table(
        "program_texts",
        sa.Column("program_id", number, nullable=False),
        sa.Column("number", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("text", sa.Text(), nullable=False),
        sa.Column("saved_ns", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(
            ["program_id"], ["programs.id"], name="fk_program_texts_program_id", ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("program_id", "number", name="pk_program_texts"),
    )
