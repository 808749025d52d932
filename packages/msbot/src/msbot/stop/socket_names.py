"""The name of a master's socket for STOP: it says what a STOP must know before it connects.

That is the STOP group, and which robot it is, should its master not answer.
"""

from __future__ import annotations

import os
import secrets
import zlib
from typing import Final

from msbot_agent.text.sentence import said, whole
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

GROUP_VARIABLE: Final = "MSBOT_STOP_GROUP"
"""The STOP group of the programs that have this variable, unless an option says another one."""
LONGEST_GROUP: Final = 24
_LONGEST_ROBOT: Final = 28
_CERTAIN_ROBOT: Final = _LONGEST_ROBOT - 12
"""A name of so many octets has not been cut: a sign has at most 12."""
_LONGEST_NUMBER: Final = 10


@dataclass(frozen=True, slots=True)
class SocketName:
    """What the name of a socket says."""

    pid: int
    mark: str
    """Tells it from others of the same process."""
    group: str
    """Its STOP group; empty: none."""
    robot: str
    """Name and serial number, perhaps cut."""
    database: str = ""
    """A mark of the robot's database (`database_mark`); empty: not known."""

    def __str__(self) -> str:
        """As a name in a folder, in ASCII, of at most 80 octets."""
        return f"{self.pid}-{self.mark}.{self.group}.{self.database}.{_plain(self.robot)}"

    def may_be(self, robot: object, database: object) -> bool:
        """Whether it may be that robot (its name or serial number; None: any) of that database (None: any)."""
        if database is not None and self.database not in ("", database_mark(str(database))):
            return False
        if robot is None or len(_plain(self.robot)) > _CERTAIN_ROBOT:
            return True
        robot = whole(str(robot))
        return self.robot.startswith(f"{robot} ") or self.robot.endswith(f" {robot}") or self.robot in ("", robot)


def name_in(text: str) -> SocketName | None:
    """What a name says; None: it is none of ours."""
    fields = text.split(".")
    if len(fields) != 4 or not text.isascii():
        return None
    number, group, database, robot = fields
    pid, _, mark = number.partition("-")
    if not (pid.isdecimal() and len(pid) <= _LONGEST_NUMBER and mark.isalnum()):
        return None
    return SocketName(int(pid), mark, group, _unplain(robot), database)


def new_name(robot: str, group: str, database: str = "") -> SocketName:
    """A name for a socket of this process.

    Args:
        robot: the robot's name and serial number.
        group: its STOP group; empty: none.
        database: which database it uses, see `database_identity`.
    """
    return SocketName(os.getpid(), secrets.token_hex(3), group, robot, database_mark(database) if database else "")


def database_mark(database: str) -> str:
    """A short mark of a database, to tell it from others of this computer."""
    return f"{zlib.crc32(database.encode('utf-8', 'surrogateescape')):08x}"


def group_in(text: str) -> str:
    """The STOP group that somebody has written; empty: none.

    Raises:
        ConfigError: it is no name for one.
    """
    if len(text) > LONGEST_GROUP or not all(sign.isascii() and (sign.isalnum() or sign in "-_") for sign in text):
        raise ConfigError(
            said(
                "{name!r} is no name for a STOP group: it has at most {most} letters of a to z, digits, - and _",
                name=text[:60],
                most=LONGEST_GROUP,
            )
        )
    return text


def own_group() -> str:
    """The STOP group of this program, as `$MSBOT_STOP_GROUP` says.

    Raises:
        ConfigError: as for `group_in`.
    """
    try:
        return group_in(os.environ.get(GROUP_VARIABLE, ""))
    except ConfigError as error:
        raise ConfigError(f"${GROUP_VARIABLE}: {error}") from None


def group_to_stop() -> tuple[str, str]:
    """The STOP group of a STOP that names none, and what is wrong with `$MSBOT_STOP_GROUP`; empty: nothing.

    Without a group that can be used it is for all robots of the user: one that stands still for nothing does less harm
    than one that goes on.
    """
    try:
        return own_group(), ""
    except ConfigError as error:
        return "", str(error)


def _plain(text: str) -> str:
    made = ""
    for sign in text:
        is_plain = sign.isascii() and (sign.isalnum() or sign in "-_")
        more = sign if is_plain else "".join(f"~{octet:02x}" for octet in sign.encode("utf-8", "replace"))
        if len(made) + len(more) > _LONGEST_ROBOT:
            break
        made += more
    return made


def _unplain(text: str) -> str:
    first, *others = text.split("~")
    octets = first.encode("utf-8", "replace")
    for other in others:
        try:
            octets += bytes.fromhex(other[:2])
        except ValueError:
            octets += b"?"
        octets += other[2:].encode("utf-8", "replace")
    return octets.decode("utf-8", "replace")
