"""How a robot or agent logs: `--log-format` and `--log-level`."""

from __future__ import annotations

import logging
import pkgutil
from collections import defaultdict
from collections.abc import Callable
from functools import wraps
from importlib.util import find_spec
from typing import TextIO, TypeVar

import click

from msbot_agent.log import BURST, JournalFormatter, JsonFormatter, TerminalHandler, goes_to_journal
from msbot_agent.process.user_folders import PACKAGES, UNDIVIDED
from msbot_xrce.lazy import dataclass

LEVELS = {
    "debug": logging.DEBUG,
    "info": logging.INFO,
    "warning": logging.WARNING,
    "error": logging.ERROR,
}
EVENTS = "msbot.pnp.events"
"""The logger of what happens to parts, in JSON; quiet in other forms, in which it is said in another way."""

_C = TypeVar("_C", bound=Callable[..., object])


@dataclass(frozen=True, slots=True)
class LogOptions:
    """The user's options."""

    is_json: bool = False
    levels: tuple[tuple[str, int], ...] = ()
    """`(room, level)`; an empty room: all of them."""

    def set_up(self, level: int, stream: TextIO | None = None, *, burst: int = BURST) -> None:
        """Log to that stream, at that level unless the user wants another one.

        Args:
            level: what is logged.
            stream: where to; standard error if absent.
            burst: lines of one kind that are written in a row.
        """
        handler = TerminalHandler(stream=stream, burst=burst)
        if self.is_json:
            handler.setFormatter(JsonFormatter())
            logging.getLogger(EVENTS).setLevel(logging.INFO)
        elif goes_to_journal(handler.stream):
            handler.setFormatter(JournalFormatter())
        logging.basicConfig(level=level, handlers=[handler])
        self.apply()

    def apply(self) -> None:
        """Give each room its level."""
        for room, level in self.levels:
            for name in rooms()[room] if room else PACKAGES:
                logging.getLogger(name).setLevel(level)


def rooms() -> dict[str, list[str]]:
    """Every room of the packages that are installed, with the names of its loggers: two may have rooms of one name."""
    found = defaultdict[str, list[str]](list)
    for package in PACKAGES:
        spec = find_spec(package)
        if spec is not None and package in UNDIVIDED:
            found[UNDIVIDED[package]].append(package)
            continue
        for one in pkgutil.iter_modules(spec.submodule_search_locations if spec else []):
            if one.ispkg:
                found[one.name].append(f"{package}.{one.name}")
    return dict(found)


class RoomLevel(click.ParamType[tuple[str, int]]):
    """`debug`, `agent=debug`."""

    name = "[ROOM=]LEVEL"

    def convert(
        self, value: str | tuple[str, int], param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, int]:
        """The room and its level."""
        if isinstance(value, tuple):
            return value
        first, equals, last = value.partition("=")
        room, level = (first, last) if equals else ("", first)
        if level.lower() not in LEVELS:
            self.fail(f"{level!r} is no level; there are {', '.join(LEVELS)}", param, ctx)
        if equals and room not in rooms():
            self.fail(f"there is no room {room!r}; there are {', '.join(sorted(rooms()))}", param, ctx)
        return room, LEVELS[level.lower()]


def log_options(function: _C) -> _C:
    """Add the options to a command, which gets them as `log_wishes`."""

    @click.option(
        "--log-format",
        type=click.Choice(["text", "json"]),
        default="text",
        show_default=True,
        help="json: every line of the log is a JSON object, for programs.",
    )
    @click.option(
        "--log-level",
        "log_levels",
        type=RoomLevel(),
        multiple=True,
        help="What is logged: debug, info, warning, error; for one room with ROOM=; repeatable.",
    )
    @wraps(function)
    def wrapped(log_format: str, log_levels: tuple[tuple[str, int], ...], **others: object) -> object:
        return function(log_wishes=LogOptions(log_format == "json", log_levels), **others)

    return wrapped  # type: ignore[return-value]
