"""The tables of the registry, with a comment on each column; `docs/reference/registry.md` shows the same list.

Times are nanoseconds since 1970 (`_ns`). UIDs are 16 hexadecimal digits. A change here needs a migration in
`migrations/versions`; a test compares the two.
"""

from __future__ import annotations

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    Column,
    Double,
    ForeignKey,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    Table,
    Text,
    UniqueConstraint,
    true,
)

metadata = MetaData(
    naming_convention={
        "pk": "pk_%(table_name)s",
        "fk": "fk_%(table_name)s_%(column_0_name)s",
        "uq": "uq_%(table_name)s_%(column_0_name)s",
        "ix": "ix_%(table_name)s_%(column_0_name)s",
    }
)

BigId = BigInteger().with_variant(Integer, "sqlite")
"""An auto-incrementing number; SQLite increments only INTEGER."""

ROBOT = ""
"""In `robots.in_dds`, in place of a topic's name: what holds for the robot itself."""
STOP_GROUP = " stop_group"
"""Likewise: the robot's STOP group."""
BRIDGES = " bridges"
"""Likewise: its bridges."""
WRITTEN_LIBRARY = " library"
"""Likewise, and no topic's name either, because of its blank: the folders that the blueprint names as its library."""

robots = Table(
    "robots",
    metadata,
    Column("id", Integer, primary_key=True, comment="number of the robot in this database"),
    Column("name", Text, nullable=False, comment="robot name of the profile"),
    Column("serial_number", Text, nullable=False, comment="with the name: which robot it is"),
    Column("version", Text, nullable=False, comment="version of the profile"),
    Column("released", Text, nullable=False, comment="release date of the profile, as text"),
    Column("manufacturer", Text, nullable=False, comment="manufacturer of the profile"),
    Column("beat_period_s", Double, nullable=False, comment="a part beats that often, seconds"),
    Column("tick_period_s", Double, nullable=False, comment="life statuses are decremented that often, seconds"),
    Column("life", Integer, nullable=False, comment="life status after each beat"),
    Column("profile_period_s", Double, nullable=False, comment="the profile is repeated that often, seconds"),
    Column("explain", Boolean, nullable=False, comment="whether a refused part is told why"),
    Column("free_topics", JSON, nullable=False, comment="list of topics that everybody may use"),
    Column(
        "authentication",
        Text,
        nullable=False,
        server_default="open",
        comment="open, key or key+data: how parts are known",
    ),
    Column(
        "in_dds", JSON, nullable=False, server_default="{}", comment="topics that are in DDS for others, too, and how"
    ),
    Column("applied_ns", BigInteger, nullable=False, comment="when a blueprint was applied last"),
    Column(
        "stop",
        JSON(none_as_null=True),
        nullable=True,
        comment="the latest STOP: its number, whether it holds, by whom, why, when; NULL: nobody ever said STOP",
    ),
    UniqueConstraint("name", "serial_number"),
)

slots = Table(
    "slots",
    metadata,
    Column("id", Integer, primary_key=True, comment="number of the slot in this database"),
    Column("robot_id", ForeignKey("robots.id", ondelete="CASCADE"), nullable=False, comment="the robot it belongs to"),
    Column("name", Text, nullable=False, comment="name of the role, unique in the robot"),
    Column("position", Integer, nullable=False, comment="place in the blueprint, from 0"),
    Column("part_number", Text, nullable=False, comment="part number of what fits"),
    Column("local_name", Text, nullable=False, comment="local name that asks for this slot; empty: the slot's name"),
    Column("description", Text, nullable=False, comment="what it is for, in words"),
    Column(
        "in_blueprint",
        Boolean,
        nullable=False,
        comment="false: taken out of the blueprint; settings and memory are kept in case it comes back",
    ),
    Column(
        "origin",
        Text,
        nullable=False,
        server_default="blueprint",
        comment="blueprint or hand: who made it; one made by hand stays when a blueprint without it is applied",
    ),
    Column("configuration_version", Integer, nullable=False, comment="counts changes of bindings and settings, from 1"),
    UniqueConstraint("robot_id", "name"),
)

bindings = Table(
    "bindings",
    metadata,
    Column("id", Integer, primary_key=True, comment="counts up in the order of the blueprint"),
    Column("robot_id", ForeignKey("robots.id", ondelete="CASCADE"), nullable=False, comment="the robot it belongs to"),
    Column("topic", Text, nullable=False, comment="name of the topic"),
    Column("type_name", Text, nullable=False, comment="message type"),
    Column("slot_id", ForeignKey("slots.id", ondelete="CASCADE"), nullable=False, comment="whose port it is"),
    Column("port", Text, nullable=False, comment="the part's own name for it"),
    Column("publishes", Boolean, nullable=False, comment="true: the port writes the topic; false: it reads it"),
    Column("reliable", Boolean, nullable=False, comment="false: best effort"),
    Column("origin", Text, nullable=False, server_default="blueprint", comment="blueprint or hand: who made it"),
    Column(
        "in_use",
        Boolean,
        nullable=False,
        server_default=true(),
        comment="false: taken away by hand; kept so that applying the blueprint does not bring it back",
    ),
    UniqueConstraint("slot_id", "port", "topic", "publishes"),
    Index("ix_bindings_robot_id", "robot_id"),
)

settings = Table(
    "settings",
    metadata,
    Column("slot_id", ForeignKey("slots.id", ondelete="CASCADE"), primary_key=True, comment="the slot it belongs to"),
    Column("name", Text, primary_key=True, comment="name of the parameter"),
    Column("origin", Text, primary_key=True, comment="library, blueprint or hand: the later one of these holds"),
    Column("value", JSON, nullable=False, comment="number, truth value or text"),
    Column("changed_ns", BigInteger, nullable=False, comment="when it got this value"),
    Column("who", Text, nullable=False, server_default="", comment="who set it by hand; empty for other origins"),
)

library = Table(
    "library",
    metadata,
    Column("number", Text, primary_key=True, comment="part number"),
    Column("name", Text, nullable=False, comment="what it is, in a few words"),
    Column("manufacturer", Text, nullable=False, comment="who makes it"),
    Column("description", Text, nullable=False, comment="what it does"),
    Column("specification", Text, nullable=False, comment="electrical data in words"),
    Column("resolution", Text, nullable=False, comment="resolution in words"),
    Column("compatible_with", JSON, nullable=False, comment="list of part numbers whose slots it can fill as well"),
    Column("ports", JSON, nullable=False, comment="list of ports: name, direction, type, rate_hz, safe"),
    Column("parameters", JSON, nullable=False, comment="list of parameters: name, type, default, unit, min, max"),
    Column("source", Text, nullable=False, comment="the file it was read from"),
    Column("versions", Text, nullable=False, server_default="", comment="versions it describes; empty: every one"),
    Column("digest", Text, nullable=False, comment="changes when anything about the type changes"),
)

parts = Table(
    "parts",
    metadata,
    Column("robot_id", ForeignKey("robots.id", ondelete="CASCADE"), primary_key=True, comment="robot it was seen at"),
    Column("identity", Text, primary_key=True, comment="the UID; part number and local name when it has none"),
    Column("uid", Text, nullable=False, comment="UID of the hardware, empty when it has none"),
    Column("part_number", Text, nullable=False, comment="part number it showed last"),
    Column("local_name", Text, nullable=False, comment="local name it showed last"),
    Column("slot_id", ForeignKey("slots.id", ondelete="SET NULL"), comment="slot it is in, or was in last"),
    Column(
        "placed_slot_id",
        ForeignKey("slots.id", ondelete="SET NULL"),
        comment="slot a person has put it into; goes before all rules",
    ),
    Column("state", Text, nullable=False, comment="state after its last change"),
    Column("reason", Text, nullable=False, comment="why it is in that state"),
    Column("address", Text, nullable=False, comment="where it was heard last, in words"),
    Column("first_seen_ns", BigInteger, nullable=False, comment="when it was seen first"),
    Column("changed_ns", BigInteger, nullable=False, comment="when its state changed last"),
    Index("ix_parts_slot_id", "slot_id"),
)

blocks = Table(
    "blocks",
    metadata,
    Column("kind", Text, primary_key=True, comment="uid or number: what is blocked"),
    Column("key", Text, primary_key=True, comment="the UID or part number"),
    Column("reason", Text, nullable=False, comment="why, in words"),
    Column("since_ns", BigInteger, nullable=False, comment="since when"),
)

journal = Table(
    "journal",
    metadata,
    Column("id", BigId, primary_key=True, comment="counts up with every entry"),
    Column("robot_id", ForeignKey("robots.id", ondelete="CASCADE"), nullable=False, comment="the robot it happened to"),
    Column("at_ns", BigInteger, nullable=False, comment="when it happened"),
    Column("part", Text, nullable=False, comment="the part's name for people"),
    Column("uid", Text, nullable=False, comment="UID of the part, empty when it has none"),
    Column("part_number", Text, nullable=False, comment="part number it showed, empty before its claim"),
    Column("local_name", Text, nullable=False, comment="local name it showed"),
    Column("slot", Text, nullable=False, comment="name of the slot, empty when it had none"),
    Column("from_state", Text, nullable=False, comment="state before, empty when it was not there"),
    Column("to_state", Text, nullable=False, comment="state after"),
    Column("reason", Text, nullable=False, comment="why, in words"),
    Column("evidence", JSON, nullable=False, comment="list of [rule or message, outcome]"),
    Column("address", Text, nullable=False, comment="the peer in words"),
    Column("said", JSON, comment="reason and evidence as forms with their values, for other languages"),
    Index("ix_journal_robot_id", "robot_id", "id"),
)

node_ids = Table(
    "node_ids",
    metadata,
    Column("robot_id", ForeignKey("robots.id", ondelete="CASCADE"), primary_key=True, comment="the robot of the bus"),
    Column("link", Text, primary_key=True, comment="the CAN link, as in its address"),
    Column("node_id", Integer, primary_key=True, autoincrement=False, comment="address on the bus, 1 to 120"),
    Column("uid", Text, nullable=False, comment="UID of the part that has it"),
    Column("kept_ns", BigInteger, nullable=False, comment="when it was given or confirmed last; counts up"),
    UniqueConstraint("robot_id", "link", "uid"),
)

edits = Table(
    "edits",
    metadata,
    Column("id", BigId, primary_key=True, comment="counts up with every edit"),
    Column("robot_id", ForeignKey("robots.id", ondelete="CASCADE"), comment="the robot it changed; empty: all of them"),
    Column("at_ns", BigInteger, nullable=False, comment="when it was made"),
    Column("who", Text, nullable=False, comment="who made it"),
    Column("kind", Text, nullable=False, comment="value, place, block, bind, apply, library, user, key, or undo"),
    Column("slot", Text, nullable=False, comment="name of the slot it is about, empty when it is about none"),
    Column("words", Text, nullable=False, comment="what it did, in words"),
    Column("before", JSON, nullable=False, comment="what it changed, as it was before"),
    Column("after", JSON, nullable=False, comment="the same, as it is after"),
    Column("undone_by", BigId, comment="number of the edit that took it back"),
    Column("said", JSON, comment="words as a form with its values, for other languages"),
    Index("ix_edits_robot_id", "robot_id", "id"),
)

users = Table(
    "users",
    metadata,
    Column("name", Text, primary_key=True, comment="name to log in with"),
    Column("role", Text, nullable=False, comment="viewer, student, teacher or administrator"),
    Column("password_hash", Text, nullable=False, comment="salted hash of the password, empty when there is none"),
    Column(
        "token_hashes", JSON, nullable=False, comment="list of [what for, hash] of the tokens that stand for a password"
    ),
    Column("created_ns", BigInteger, nullable=False, comment="when the user was added"),
    Column("changed_ns", BigInteger, nullable=False, comment="when role, password or tokens changed last"),
)

keys = Table(
    "keys",
    metadata,
    Column("uid", Text, primary_key=True, comment="UID of the part"),
    Column("key", LargeBinary, nullable=False, comment="the secret that the part proves to know"),
    Column("created_ns", BigInteger, nullable=False, comment="when it was made"),
    Column("created_by", Text, nullable=False, comment="who made it"),
)

programs = Table(
    "programs",
    metadata,
    Column("id", BigId, primary_key=True, comment="number of the program"),
    Column("owner", Text, nullable=False, comment="name of the user who wrote it"),
    Column("name", Text, nullable=False, comment="its file name"),
    Column("share", Text, nullable=False, comment="word by which others may read it, empty when nobody may"),
    Column("changed_ns", BigInteger, nullable=False, comment="when its newest version was kept"),
    UniqueConstraint("owner", "name"),
    Index("ix_programs_share", "share"),
)

program_texts = Table(
    "program_texts",
    metadata,
    Column("program_id", ForeignKey("programs.id", ondelete="CASCADE"), primary_key=True, comment="the program"),
    Column("number", Integer, primary_key=True, autoincrement=False, comment="version, 1 and up"),
    Column("text", Text, nullable=False, comment="the program as it was then"),
    Column("blocks", Text, nullable=False, server_default="", comment="the blocks it was made of as JSON, empty: none"),
    Column("saved_ns", BigInteger, nullable=False, comment="when it was kept"),
)

lesson_ticks = Table(
    "lesson_ticks",
    metadata,
    Column("person", Text, primary_key=True, comment="name of the user who did it"),
    Column("lesson", Text, primary_key=True, comment="name of the lesson"),
    Column("check", Text, primary_key=True, comment="which of its checks, STEP.NUMBER; empty: the lesson was begun"),
    Column("at_ns", BigInteger, nullable=False, comment="when it ticked for the first time"),
    Column("doing", Text, nullable=False, comment="whose hand it was: `own`, `group`, `helped`, `robot`"),
    Column("done_by", Text, nullable=False, comment="who did it, empty: the person, or nobody"),
)

hand_ins = Table(
    "hand_ins",
    metadata,
    Column("id", BigId, primary_key=True, comment="number of the hand-in"),
    Column("person", Text, nullable=False, comment="name of the user who handed it in"),
    Column("lesson", Text, nullable=False, comment="name of the lesson"),
    Column("at_ns", BigInteger, nullable=False, comment="when it was handed in"),
    Column("from_ns", BigInteger, nullable=False, comment="when the person began"),
    Column("program", Text, nullable=False, comment="name of the program, empty: none"),
    Column("text", Text, nullable=False, comment="the program as it was then"),
    Column("note", Text, nullable=False, comment="what the person says of it"),
    Column("answers", JSON, nullable=False, comment="the last answer to each question, by its check"),
    Column("returned_ns", BigInteger, nullable=False, comment="when it was returned, 0: not yet"),
    Column("returned_by", Text, nullable=False, comment="who returned it, empty: nobody"),
    Column("comment", Text, nullable=False, comment="what the teacher says of it"),
    Column("recording", LargeBinary, nullable=False, comment="copy of the robot's recording, MCAP, empty: none"),
    Column("recorded_from_ns", BigInteger, nullable=False, comment="when that copy begins"),
    Column("recorded_to_ns", BigInteger, nullable=False, comment="when it ends"),
    Index("ix_hand_ins_person", "person", "lesson"),
)

class_groups = Table(
    "class_groups",
    metadata,
    Column("robot_id", ForeignKey("robots.id", ondelete="CASCADE"), primary_key=True, comment="the robot"),
    Column("kind", Text, primary_key=True, comment="`pupil` or `slot`"),
    Column("name", Text, primary_key=True, comment="name of the user, or of the slot"),
    Column("group_name", Text, nullable=False, comment="the group that this pupil or slot belongs to"),
)

master_leases = Table(
    "master_leases",
    metadata,
    Column("robot_id", ForeignKey("robots.id", ondelete="CASCADE"), primary_key=True, comment="the robot"),
    Column("epoch", BigInteger, nullable=False, comment="how often a master has taken it over"),
    Column("holder", Text, nullable=False, comment="the master that serves it, in words"),
    Column("until_ns", BigInteger, nullable=False, comment="until when, by the server's clock; 0: nobody"),
)
