"""The schema of 0.1.0: robots, slots, wires, settings, library, parts, journal, edits, people, keys, programs."""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision: str | None = None


def upgrade() -> None:
    """Create all tables, those that others refer to first."""
    _blocks()
    _keys()
    _hand_ins()
    _lesson_ticks()
    _library()
    _programs()
    _robots()
    _users()
    _class_groups()
    _edits()
    _journal()
    _master_leases()
    _node_ids()
    _program_texts()
    _slots()
    _bindings()
    _parts()
    _settings()


def _blocks() -> None:
    op.create_table(
        "blocks",
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("key", sa.Text(), nullable=False),
        sa.Column("reason", sa.Text(), nullable=False),
        sa.Column("since_ns", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("kind", "key", name="pk_blocks"),
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


def _hand_ins() -> None:
    op.create_table(
        "hand_ins",
        sa.Column("id", sa.BigInteger().with_variant(sa.Integer(), "sqlite"), nullable=False),
        sa.Column("person", sa.Text(), nullable=False),
        sa.Column("lesson", sa.Text(), nullable=False),
        sa.Column("at_ns", sa.BigInteger(), nullable=False),
        sa.Column("from_ns", sa.BigInteger(), nullable=False),
        sa.Column("program", sa.Text(), nullable=False),
        sa.Column("text", sa.Text(), nullable=False),
        sa.Column("note", sa.Text(), nullable=False),
        sa.Column("answers", sa.JSON(), nullable=False),
        sa.Column("returned_ns", sa.BigInteger(), nullable=False),
        sa.Column("returned_by", sa.Text(), nullable=False),
        sa.Column("comment", sa.Text(), nullable=False),
        sa.Column("recording", sa.LargeBinary(), nullable=False),
        sa.Column("recorded_from_ns", sa.BigInteger(), nullable=False),
        sa.Column("recorded_to_ns", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_hand_ins"),
    )
    op.create_index("ix_hand_ins_person", "hand_ins", ["person", "lesson"], unique=False)


def _lesson_ticks() -> None:
    op.create_table(
        "lesson_ticks",
        sa.Column("person", sa.Text(), nullable=False),
        sa.Column("lesson", sa.Text(), nullable=False),
        sa.Column("check", sa.Text(), nullable=False),
        sa.Column("at_ns", sa.BigInteger(), nullable=False),
        sa.Column("doing", sa.Text(), nullable=False),
        sa.Column("done_by", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("person", "lesson", "check", name="pk_lesson_ticks"),
    )


def _library() -> None:
    op.create_table(
        "library",
        sa.Column("number", sa.Text(), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("manufacturer", sa.Text(), nullable=False),
        sa.Column("description", sa.Text(), nullable=False),
        sa.Column("specification", sa.Text(), nullable=False),
        sa.Column("resolution", sa.Text(), nullable=False),
        sa.Column("compatible_with", sa.JSON(), nullable=False),
        sa.Column("ports", sa.JSON(), nullable=False),
        sa.Column("parameters", sa.JSON(), nullable=False),
        sa.Column("source", sa.Text(), nullable=False),
        sa.Column("versions", sa.Text(), server_default="", nullable=False),
        sa.Column("digest", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("number", name="pk_library"),
    )


def _programs() -> None:
    op.create_table(
        "programs",
        sa.Column("id", sa.BigInteger().with_variant(sa.Integer(), "sqlite"), nullable=False),
        sa.Column("owner", sa.Text(), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("share", sa.Text(), nullable=False),
        sa.Column("changed_ns", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_programs"),
        sa.UniqueConstraint("owner", "name", name="uq_programs_owner"),
    )
    op.create_index("ix_programs_share", "programs", ["share"], unique=False)


def _robots() -> None:
    op.create_table(
        "robots",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("serial_number", sa.Text(), nullable=False),
        sa.Column("version", sa.Text(), nullable=False),
        sa.Column("released", sa.Text(), nullable=False),
        sa.Column("manufacturer", sa.Text(), nullable=False),
        sa.Column("beat_period_s", sa.Double(), nullable=False),
        sa.Column("tick_period_s", sa.Double(), nullable=False),
        sa.Column("life", sa.Integer(), nullable=False),
        sa.Column("profile_period_s", sa.Double(), nullable=False),
        sa.Column("explain", sa.Boolean(), nullable=False),
        sa.Column("free_topics", sa.JSON(), nullable=False),
        sa.Column("authentication", sa.Text(), server_default="open", nullable=False),
        sa.Column("in_dds", sa.JSON(), server_default="{}", nullable=False),
        sa.Column("applied_ns", sa.BigInteger(), nullable=False),
        sa.Column("stop", sa.JSON(none_as_null=True), nullable=True),
        sa.PrimaryKeyConstraint("id", name="pk_robots"),
        sa.UniqueConstraint("name", "serial_number", name="uq_robots_name"),
    )


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


def _class_groups() -> None:
    op.create_table(
        "class_groups",
        sa.Column("robot_id", sa.Integer(), nullable=False),
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("group_name", sa.Text(), nullable=False),
        sa.ForeignKeyConstraint(["robot_id"], ["robots.id"], name="fk_class_groups_robot_id", ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("robot_id", "kind", "name", name="pk_class_groups"),
    )


def _edits() -> None:
    op.create_table(
        "edits",
        sa.Column("id", sa.BigInteger().with_variant(sa.Integer(), "sqlite"), nullable=False),
        sa.Column("robot_id", sa.Integer(), nullable=True),
        sa.Column("at_ns", sa.BigInteger(), nullable=False),
        sa.Column("who", sa.Text(), nullable=False),
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("slot", sa.Text(), nullable=False),
        sa.Column("words", sa.Text(), nullable=False),
        sa.Column("before", sa.JSON(), nullable=False),
        sa.Column("after", sa.JSON(), nullable=False),
        sa.Column("undone_by", sa.BigInteger().with_variant(sa.Integer(), "sqlite"), nullable=True),
        sa.Column("said", sa.JSON(), nullable=True),
        sa.ForeignKeyConstraint(["robot_id"], ["robots.id"], name="fk_edits_robot_id", ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("id", name="pk_edits"),
    )
    op.create_index("ix_edits_robot_id", "edits", ["robot_id", "id"], unique=False)


def _journal() -> None:
    op.create_table(
        "journal",
        sa.Column("id", sa.BigInteger().with_variant(sa.Integer(), "sqlite"), nullable=False),
        sa.Column("robot_id", sa.Integer(), nullable=False),
        sa.Column("at_ns", sa.BigInteger(), nullable=False),
        sa.Column("part", sa.Text(), nullable=False),
        sa.Column("uid", sa.Text(), nullable=False),
        sa.Column("part_number", sa.Text(), nullable=False),
        sa.Column("local_name", sa.Text(), nullable=False),
        sa.Column("slot", sa.Text(), nullable=False),
        sa.Column("from_state", sa.Text(), nullable=False),
        sa.Column("to_state", sa.Text(), nullable=False),
        sa.Column("reason", sa.Text(), nullable=False),
        sa.Column("evidence", sa.JSON(), nullable=False),
        sa.Column("address", sa.Text(), nullable=False),
        sa.Column("said", sa.JSON(), nullable=True),
        sa.ForeignKeyConstraint(["robot_id"], ["robots.id"], name="fk_journal_robot_id", ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("id", name="pk_journal"),
    )
    op.create_index("ix_journal_robot_id", "journal", ["robot_id", "id"], unique=False)


def _master_leases() -> None:
    op.create_table(
        "master_leases",
        sa.Column("robot_id", sa.Integer(), nullable=False),
        sa.Column("epoch", sa.BigInteger(), nullable=False),
        sa.Column("holder", sa.Text(), nullable=False),
        sa.Column("until_ns", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(["robot_id"], ["robots.id"], name="fk_master_leases_robot_id", ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("robot_id", name="pk_master_leases"),
    )


def _node_ids() -> None:
    op.create_table(
        "node_ids",
        sa.Column("robot_id", sa.Integer(), nullable=False),
        sa.Column("link", sa.Text(), nullable=False),
        sa.Column("node_id", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("uid", sa.Text(), nullable=False),
        sa.Column("kept_ns", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(["robot_id"], ["robots.id"], name="fk_node_ids_robot_id", ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("robot_id", "link", "node_id", name="pk_node_ids"),
        sa.UniqueConstraint("robot_id", "link", "uid", name="uq_node_ids_robot_id"),
    )


def _program_texts() -> None:
    op.create_table(
        "program_texts",
        sa.Column("program_id", sa.BigInteger().with_variant(sa.Integer(), "sqlite"), nullable=False),
        sa.Column("number", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("text", sa.Text(), nullable=False),
        sa.Column("blocks", sa.Text(), server_default="", nullable=False),
        sa.Column("saved_ns", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(
            ["program_id"], ["programs.id"], name="fk_program_texts_program_id", ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("program_id", "number", name="pk_program_texts"),
    )


def _slots() -> None:
    op.create_table(
        "slots",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("robot_id", sa.Integer(), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("position", sa.Integer(), nullable=False),
        sa.Column("part_number", sa.Text(), nullable=False),
        sa.Column("local_name", sa.Text(), nullable=False),
        sa.Column("description", sa.Text(), nullable=False),
        sa.Column("in_blueprint", sa.Boolean(), nullable=False),
        sa.Column("origin", sa.Text(), server_default="blueprint", nullable=False),
        sa.Column("configuration_version", sa.Integer(), nullable=False),
        sa.ForeignKeyConstraint(["robot_id"], ["robots.id"], name="fk_slots_robot_id", ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("id", name="pk_slots"),
        sa.UniqueConstraint("robot_id", "name", name="uq_slots_robot_id"),
    )


def _bindings() -> None:
    op.create_table(
        "bindings",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("robot_id", sa.Integer(), nullable=False),
        sa.Column("topic", sa.Text(), nullable=False),
        sa.Column("type_name", sa.Text(), nullable=False),
        sa.Column("slot_id", sa.Integer(), nullable=False),
        sa.Column("port", sa.Text(), nullable=False),
        sa.Column("publishes", sa.Boolean(), nullable=False),
        sa.Column("reliable", sa.Boolean(), nullable=False),
        sa.Column("origin", sa.Text(), server_default="blueprint", nullable=False),
        sa.Column("in_use", sa.Boolean(), server_default=sa.true(), nullable=False),
        sa.ForeignKeyConstraint(["robot_id"], ["robots.id"], name="fk_bindings_robot_id", ondelete="CASCADE"),
        sa.ForeignKeyConstraint(["slot_id"], ["slots.id"], name="fk_bindings_slot_id", ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("id", name="pk_bindings"),
        sa.UniqueConstraint("slot_id", "port", "topic", "publishes", name="uq_bindings_slot_id"),
    )
    op.create_index("ix_bindings_robot_id", "bindings", ["robot_id"], unique=False)


def _parts() -> None:
    op.create_table(
        "parts",
        sa.Column("robot_id", sa.Integer(), nullable=False),
        sa.Column("identity", sa.Text(), nullable=False),
        sa.Column("uid", sa.Text(), nullable=False),
        sa.Column("part_number", sa.Text(), nullable=False),
        sa.Column("local_name", sa.Text(), nullable=False),
        sa.Column("slot_id", sa.Integer(), nullable=True),
        sa.Column("placed_slot_id", sa.Integer(), nullable=True),
        sa.Column("state", sa.Text(), nullable=False),
        sa.Column("reason", sa.Text(), nullable=False),
        sa.Column("address", sa.Text(), nullable=False),
        sa.Column("first_seen_ns", sa.BigInteger(), nullable=False),
        sa.Column("changed_ns", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(["placed_slot_id"], ["slots.id"], name="fk_parts_placed_slot_id", ondelete="SET NULL"),
        sa.ForeignKeyConstraint(["robot_id"], ["robots.id"], name="fk_parts_robot_id", ondelete="CASCADE"),
        sa.ForeignKeyConstraint(["slot_id"], ["slots.id"], name="fk_parts_slot_id", ondelete="SET NULL"),
        sa.PrimaryKeyConstraint("robot_id", "identity", name="pk_parts"),
    )
    op.create_index("ix_parts_slot_id", "parts", ["slot_id"], unique=False)


def _settings() -> None:
    op.create_table(
        "settings",
        sa.Column("slot_id", sa.Integer(), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("origin", sa.Text(), nullable=False),
        sa.Column("value", sa.JSON(), nullable=False),
        sa.Column("changed_ns", sa.BigInteger(), nullable=False),
        sa.Column("who", sa.Text(), server_default="", nullable=False),
        sa.ForeignKeyConstraint(["slot_id"], ["slots.id"], name="fk_settings_slot_id", ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("slot_id", "name", "origin", name="pk_settings"),
    )
