"""Part types that people take out of the library while the robot runs."""

from __future__ import annotations

from sqlalchemy import Connection, delete, select

from msbot.registry.database.tables import library, slots
from msbot.registry.edits.edit_log import Author, record
from msbot.registry.records import EditKind, EditRecord
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError


def forget_part_type(connection: Connection, author: Author, number: str) -> EditRecord:
    """Delete a part type that no robot of the database has a slot for.

    Raises:
        ConfigError: a robot has one.
    """
    used = select(slots.c.name).where(slots.c.part_number == number, slots.c.in_blueprint).limit(1)
    if (slot := connection.execute(used).scalar()) is not None:
        raise ConfigError(said("{number} has slots: {slots}; take them out first", number=number, slots=slot))
    connection.execute(delete(library).where(library.c.number == number))
    words = said("{number} is forgotten: the library does not know it any more", number=number)
    return record(connection, author, EditKind.LIBRARY, words)
