"""How a command runs parts that are wired to this computer: links, UIDs, keys, signals."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

from msbot.part import Part
from msbot.part.join.keys import given_key
from msbot.part.join.uid import parse_uid, stored_uid
from msbot.part.run import CAN
from msbot_agent.link import Link, open_link
from msbot_agent.log.terminal_log import TerminalHandler
from msbot_agent.process.end_signals import on_end_signal
from msbot_agent.process.event_loop import run_to_end
from msbot_agent.process.patient_output import patient_output

if TYPE_CHECKING:
    from collections.abc import Coroutine


class Endable(Protocol):
    """Something that runs until it is told to end."""

    def end(self) -> None:
        """End cleanly."""


def connect(part: Part, link: str) -> Link:
    """A link for one part."""
    return open_link(link, can=replace(CAN, uid=part.uid))


def identify(part: Part, *, uid: str | None = None, key: str | None = None) -> None:
    """Give a part its UID and its key: those given, or those kept on this computer.

    Raises:
        ConfigError: one of them is malformed.
    """
    part.uid = stored_uid(part.part_number, part.local_name) if uid is None else parse_uid(uid)
    part.key = given_key(key, part.part_number, part.local_name)


def run_until_told(make: Callable[[], tuple[Endable, Coroutine[object, object, None]]], *, quiet: bool) -> None:
    """Run what `make` returns, on a loop of its own, until it ends or a signal ends it cleanly.

    Args:
        make: called on the loop; returns what to tell to end, and what to run.
        quiet: print only what is wrong.
    """
    logging.basicConfig(level=logging.WARNING if quiet else logging.INFO, handlers=[TerminalHandler()])

    async def main() -> None:
        unit, work = make()
        on_end_signal(unit.end)
        await work

    with contextlib.suppress(KeyboardInterrupt), patient_output():
        run_to_end(main())
