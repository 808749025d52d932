"""The latest STOP of a robot, as its database stores it."""

from __future__ import annotations

from dataclasses import asdict

from sqlalchemy import Connection, select, update

from msbot.pnp import StopRecord
from msbot.registry.database.tables import robots


def read(connection: Connection, robot_id: int) -> StopRecord | None:
    """The stored record; None: nobody ever said STOP."""
    kept = connection.execute(select(robots.c.stop).where(robots.c.id == robot_id)).scalar_one_or_none()
    return None if kept is None else StopRecord(**kept)


def write(connection: Connection, robot_id: int, record: StopRecord) -> None:
    """Store it in place of the previous one."""
    connection.execute(update(robots).where(robots.c.id == robot_id).values(stop=asdict(record)))
