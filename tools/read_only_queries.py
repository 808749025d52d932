"""Writes `packages/msbot/src/msbot/registry/read_only_queries.py` from the registry's tables.

    python tools/read_only_queries.py

Run it after a change of the tables; a test compares.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from textwrap import fill
from typing import Any

from sqlalchemy import BindParameter, Select, Table, bindparam, func, or_, select
from sqlalchemy.dialects import sqlite

import msbot.registry
from msbot.registry.database.tables import bindings, journal, library, parts, robots, slots

REGISTRY = Path(msbot.registry.__path__[0])
TARGET = REGISTRY / "read_only_queries.py"
HEAD = '''"""What a quick look asks a SQLite file, for Python's own sqlite3.

Written by tools/read_only_queries.py from the registry's tables.
"""

from __future__ import annotations

from typing import Final

'''
WIDTH = 118


def queries() -> Mapping[str, tuple[Select[Any], str]]:
    """Each query by its name, with its columns in the order that the reader expects, and what it says of itself."""
    robot: BindParameter[int] = bindparam("robot")
    part: BindParameter[str] = bindparam("part")
    of_robot = or_(robot.is_(None), robots.c.id == robot)
    about = [
        or_(name == part, func.lower(name) == bindparam("small"))
        for name in (journal.c.part, journal.c.slot, journal.c.local_name, journal.c.part_number, journal.c.uid)
    ]
    return {
        "ROBOTS": (
            _columns(
                robots, "id", "name", "serial_number", "version", "released", "manufacturer", "applied_ns"
            ).order_by(robots.c.applied_ns.desc()),
            "All robots, the one with the most recently applied blueprint first.",
        ),
        "SLOT_NAMES": (
            select(slots.c.name).where(slots.c.robot_id == robot, slots.c.in_blueprint).order_by(slots.c.position),
            "The slots of the blueprint of `robot`.",
        ),
        "TOPICS": (
            select(bindings.c.topic)
            .where(bindings.c.robot_id == robot, bindings.c.in_use)
            .distinct()
            .order_by(bindings.c.topic),
            "The topics of `robot` that ports are bound to.",
        ),
        "SLOT_TYPES": (
            select(slots.c.name, library.c.ports, library.c.parameters)
            .join(library, slots.c.part_number == library.c.number)
            .where(slots.c.robot_id == robot, slots.c.in_blueprint)
            .order_by(slots.c.position),
            "The slots of `robot` with the ports and parameters of their part types.",
        ),
        "PARTS": (
            select(
                parts.c.uid,
                parts.c.part_number,
                parts.c.local_name,
                slots.c.name.label("slot"),
                parts.c.state,
                parts.c.reason,
                parts.c.address,
                parts.c.first_seen_ns,
                parts.c.changed_ns,
            )
            .outerjoin(slots, parts.c.slot_id == slots.c.id)
            .where(parts.c.robot_id == robot)
            .order_by(slots.c.position.is_(None), slots.c.position, parts.c.first_seen_ns),
            "The parts of `robot`, those in slots first.",
        ),
        "JOURNAL": (
            select(
                journal.c.id,
                robots.c.name.label("robot"),
                *(
                    journal.c[name]
                    for name in (
                        "at_ns",
                        "part",
                        "slot",
                        "from_state",
                        "to_state",
                        "reason",
                        "evidence",
                        "part_number",
                        "local_name",
                        "uid",
                        "address",
                        "said",
                    )
                ),
            )
            .join(robots, journal.c.robot_id == robots.c.id)
            .where(or_(*about), of_robot)
            .order_by(journal.c.id.desc()),
            "Lines about a `part` (`small`: in small letters), of `robot` if that is not None, the newest first.",
        ),
    }


def _columns(table: Table, *names: str) -> Select[Any]:
    return select(*(table.c[name] for name in names))


def text() -> str:
    """The file."""
    newest = max(path.name[1:5] for path in (REGISTRY / "migrations" / "versions").glob("v*.py"))
    said = f'SCHEMA: Final = "{newest}"\n'
    said += '"""The schema that the queries know; a database with another one is not read by them."""\n'
    for name, (query, words) in queries().items():
        sql = str(query.compile(dialect=sqlite.dialect(paramstyle="named")))
        said += f'{name}: Final = """\n{fill(" ".join(sql.split()), WIDTH)}\n"""\n"""{words}"""\n'
    return HEAD + said


if __name__ == "__main__":
    TARGET.write_text(text())
