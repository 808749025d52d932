"""The masters on this computer, for the class view: who is there, and one STOP for all.

They are asked over STOP's own socket (`msbot.stop.stop_request`), all at once and in a thread, so that a master
that hangs keeps no page waiting.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from urllib.parse import urlsplit

from msbot.stop.stop_request import SilentMaster, ask_masters
from msbot_agent.text.untrusted_input import parse_count
from msbot_xrce.lazy import dataclass

MOST_TEXT = 4096
"""Of a text that a master says; paths and names are shorter."""
Ask = Callable[[Mapping[str, object]], tuple[list[dict[str, object]], Sequence[SilentMaster]]]
"""Asks every master of this user; gives the answers, and who runs and does not answer."""


@dataclass(frozen=True, slots=True)
class LocalMaster:
    """A master of this computer, as it says itself."""

    robot: str
    serial_number: str
    page: str
    """The address of its page; empty when it has none."""
    slots: int
    active: int
    """Parts that are in."""
    stopped: bool
    database: str = ""
    """Which database it uses, see `database_identity`."""
    version: str = ""
    blueprint: str = ""
    """The mark of its blueprint in force."""
    msbot: str = ""
    """The version of MsBOT that runs it."""
    stop_group: str = ""
    """Its STOP group; empty: none."""


@dataclass(frozen=True, slots=True)
class StopForAll:
    """The outcome of one STOP for all robots."""

    told: tuple[str, ...]
    """Robots whose master has taken it."""
    confirmed: int
    """Parts that had confirmed it when the masters answered."""
    parts: int
    """Parts that were told."""
    silent: int
    """Masters that run and gave no answer."""
    waiting: tuple[str, ...] = ()
    """Robots with parts that had not confirmed it then, with their names."""
    not_stored: tuple[str, ...] = ()
    """Robots at which it ends with their masters."""
    not_told: tuple[str, ...] = ()
    """Robots elsewhere whose masters have not taken it, with the reason."""


class LocalMasters:
    """The masters of this user on this computer, this one among them."""

    def __init__(self, ask: Ask = ask_masters) -> None:
        self._ask = ask

    @staticmethod
    def of_group(group: Callable[[], str]) -> LocalMasters:
        """The masters of a STOP group; empty: all."""
        return LocalMasters(lambda request: ask_masters(request, group=group()))

    async def find(self) -> Sequence[LocalMaster]:
        """Those that answer."""
        answers, _ = await asyncio.to_thread(self._ask, {"do": "status", "who": "page"})
        return [_neighbour(answer) for answer in answers]

    async def stop_all(self, who: str, reason: str, page_of: str, database: str | None = None) -> StopForAll:
        """STOP to every one of them.

        Args:
            who: who says it.
            reason: why.
            page_of: the robot on whose page it is said.
            database: only to robots of this database (`database_identity`); None: of any.
        """
        request = {"do": "stop", "who": who, "reason": reason, "page_of": page_of, "database": database}
        answers, silent = await asyncio.to_thread(self._ask, request)
        taken = [answer for answer in answers if answer.get("stopped") is True]
        return StopForAll(
            told=tuple(str(answer.get("robot", "")) for answer in taken),
            confirmed=sum(len(found) for answer in taken if isinstance(found := answer.get("confirmed"), list)),
            parts=sum(parse_count(answer.get("told")) for answer in taken),
            silent=len(silent) + len(answers) - len(taken),
            waiting=tuple(
                f"{answer.get('robot', '')} ({', '.join(map(str, names))})"
                for answer in taken
                if isinstance(names := answer.get("silent"), list) and names
            ),
            not_stored=tuple(str(answer.get("robot", "")) for answer in taken if answer.get("stored") is False),
        )


def _neighbour(answer: Mapping[str, object]) -> LocalMaster:
    def text(key: str) -> str:
        found = answer.get(key, "")
        return found[:MOST_TEXT] if isinstance(found, str) else ""

    return LocalMaster(
        text("robot"),
        text("serial_number"),
        _link_to(text("page")),
        parse_count(answer.get("slots")),
        parse_count(answer.get("active")),
        answer.get("stopped") is True,
        text("database"),
        text("version"),
        text("blueprint"),
        text("msbot"),
        text("stop_group"),
    )


def _link_to(address: str) -> str:
    """The address of a page; empty when it is none: a link to anything else would do what the master likes."""
    try:
        found = urlsplit(address)
        return address if found.scheme in ("http", "https") and found.hostname and found.port != 0 else ""
    except ValueError:
        return ""
