"""What a quick look asks a SQLite file, for Python's own sqlite3.

Written by tools/read_only_queries.py from the registry's tables.
"""

from __future__ import annotations

from typing import Final

SCHEMA: Final = "0001"
"""The schema that the queries know; a database with another one is not read by them."""
ROBOTS: Final = """
SELECT robots.id, robots.name, robots.serial_number, robots.version, robots.released, robots.manufacturer,
robots.applied_ns FROM robots ORDER BY robots.applied_ns DESC
"""
"""All robots, the one with the most recently applied blueprint first."""
SLOT_NAMES: Final = """
SELECT slots.name FROM slots WHERE slots.robot_id = :robot AND slots.in_blueprint = 1 ORDER BY slots.position
"""
"""The slots of the blueprint of `robot`."""
TOPICS: Final = """
SELECT DISTINCT bindings.topic FROM bindings WHERE bindings.robot_id = :robot AND bindings.in_use = 1 ORDER BY
bindings.topic
"""
"""The topics of `robot` that ports are bound to."""
SLOT_TYPES: Final = """
SELECT slots.name, library.ports, library.parameters FROM slots JOIN library ON slots.part_number = library.number
WHERE slots.robot_id = :robot AND slots.in_blueprint = 1 ORDER BY slots.position
"""
"""The slots of `robot` with the ports and parameters of their part types."""
PARTS: Final = """
SELECT parts.uid, parts.part_number, parts.local_name, slots.name AS slot, parts.state, parts.reason, parts.address,
parts.first_seen_ns, parts.changed_ns FROM parts LEFT OUTER JOIN slots ON parts.slot_id = slots.id WHERE
parts.robot_id = :robot ORDER BY slots.position IS NULL, slots.position, parts.first_seen_ns
"""
"""The parts of `robot`, those in slots first."""
JOURNAL: Final = """
SELECT journal.id, robots.name AS robot, journal.at_ns, journal.part, journal.slot, journal.from_state,
journal.to_state, journal.reason, journal.evidence, journal.part_number, journal.local_name, journal.uid,
journal.address, journal.said FROM journal JOIN robots ON journal.robot_id = robots.id WHERE (journal.part = :part OR
lower(journal.part) = :small OR journal.slot = :part OR lower(journal.slot) = :small OR journal.local_name = :part OR
lower(journal.local_name) = :small OR journal.part_number = :part OR lower(journal.part_number) = :small OR
journal.uid = :part OR lower(journal.uid) = :small) AND (:robot IS NULL OR robots.id = :robot) ORDER BY journal.id
DESC
"""
"""Lines about a `part` (`small`: in small letters), of `robot` if that is not None, the newest first."""
