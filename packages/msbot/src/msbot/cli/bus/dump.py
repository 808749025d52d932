"""Every frame of a bus or of a log, with what it says: `msbot bus dump`."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable
from pathlib import Path
from typing import Final

import click

from msbot.cli.bus.bus_source import Listening, is_log, open_bus
from msbot.cli.bus.frame_log import FrameReader, FrameWriter
from msbot.cli.bus.frame_words import WordsFormat, tell_unknown, told_lines
from msbot.pnp import FrameListener, FrameWords
from msbot_agent.link.can.protocol import NODES, CanIds, Frame, LogLine
from msbot_agent.process.end_signals import run_to_end
from msbot_xrce.lazy import dataclass

# Which frames of a bus somebody wants to see: `--filter 100:780`, `--filter 7FF~7FF`, `--filter node=3`.


_IDS = CanIds()
_WORDS = re.compile(r"([0-9A-Fa-f]{1,8})(?:([:~])([0-9A-Fa-f]{1,8}))?")


@dataclass(frozen=True, slots=True)
class FrameFilter:
    """One filter; a frame is shown when it matches at least one."""

    can_id: int
    mask: int
    extended: bool
    inverse: bool = False

    def matches(self, frame: Frame) -> bool:
        """Whether the frame is wanted."""
        hit = frame.extended == self.extended and not (frame.can_id ^ self.can_id) & self.mask
        return hit is not self.inverse


class FilterType(click.ParamType[tuple[FrameFilter, ...]]):
    """`ID`, `ID:MASK`, `ID~MASK` (all but those), each hexadecimal, or `node=N`."""

    name = "FILTER"

    def convert(
        self,
        value: str | tuple[FrameFilter, ...],
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> tuple[FrameFilter, ...]:
        """The filters that one option stands for."""
        if isinstance(value, tuple):
            return value
        if value.startswith("node="):
            digits = value.removeprefix("node=")
            if not (digits.isascii() and digits.isdigit() and 1 <= int(digits) <= NODES):
                self.fail(f"{value!r}: the nodes of a bus are 1 to {NODES}", param, ctx)
            return tuple(FrameFilter(base + int(digits), 0x7FF, extended=False) for base in (_IDS.up, _IDS.down))
        match = _WORDS.fullmatch(value)
        if match is None:
            self.fail(
                f"{value!r}: write ID, ID:MASK, ID~MASK (all but those) or node=N, for example 100:780", param, ctx
            )
        extended = len(match[1]) > 3
        mask = int(match[3], 16) if match[3] else 0x1FFFFFFF if extended else 0x7FF
        return (FrameFilter(int(match[1], 16), mask, extended, match[2] == "~"),)


def wanted(frame: Frame, filters: tuple[FrameFilter, ...]) -> bool:
    """Whether a frame matches a filter, or there are no filters."""
    return not filters or any(wish.matches(frame) for wish in filters)


COLOURS: Final = ("cyan", "green", "yellow", "magenta", "blue", "bright_cyan", "bright_green", "bright_yellow")
"""Colours of the frames to and from a node, by its number, on a terminal."""

_NO_WORDS: Final = FrameWords((), (), ())


@dataclass(frozen=True, slots=True)
class DumpOptions:
    """The user's options."""

    decode: bool = True
    log: Path | None = None
    filters: tuple[FrameFilter, ...] = ()
    count: int | None = None


@dataclass(frozen=True, slots=True)
class Understanding:
    """Who understands the frames, and how it is told."""

    listener: FrameListener
    manner: WordsFormat = WordsFormat.PROTOCOL


class Dump:
    """Shows frames one after the other; `finished` once enough were shown."""

    def __init__(self, wishes: DumpOptions, say: Callable[[str], None]) -> None:
        """Prepare; what is heard before `begin` is shown then.

        Raises:
            ConfigError: the log cannot be written.
        """
        self._understanding: Understanding | None = None
        self._early: list[LogLine] = []
        """Heard before `begin`; a master that is asked has seconds to answer."""
        self._wishes = wishes
        self._say = say
        self._writer = None if wishes.log is None else FrameWriter(wishes.log)
        self._shown = 0

    @property
    def finished(self) -> bool:
        """Whether as many frames as requested were shown."""
        return self._wishes.count is not None and self._shown >= self._wishes.count

    def begin(self, understanding: Understanding) -> None:
        """Show what was heard so far, and from now on every frame at once."""
        self._understanding = understanding
        for line in self._early:
            self.show(line)
        self._early.clear()

    def show(self, line: LogLine) -> None:
        """Show one frame; frames that are filtered out are decoded, too, because later frames may depend on them."""
        if self.finished:
            return
        if self._understanding is None:
            self._early.append(line)
            return
        words = (
            self._understanding.listener.explain_frame(line.frame, line.at or 0.0) if self._wishes.decode else _NO_WORDS
        )
        if not wanted(line.frame, self._wishes.filters):
            return
        self._shown += 1
        if self._writer is not None:
            self._writer.write(line)
        manner = self._understanding.manner
        for text in told_lines(line, words, manner):
            self._say(text if manner is WordsFormat.JSON else click.style(text.rstrip(), fg=colour_of(line.frame)))

    def close(self) -> None:
        """Close the log."""
        if self._writer is not None:
            self._writer.close()


def colour_of(frame: Frame) -> str | None:
    """The colour of a frame's node; red for reports of errors and STOP; None for everything else."""
    if frame.error or (frame.can_id == _IDS.stop and not frame.extended):
        return "red"
    for base in (_IDS.up, _IDS.down):
        if 0 < frame.can_id - base <= NODES and not frame.extended:
            return COLOURS[(frame.can_id - base) % len(COLOURS)]
    return None


def dump(
    name: str,
    wishes: DumpOptions,
    understand: Callable[[], Understanding],
    say: Callable[[str], None],
    complain: Callable[[str], None],
) -> None:
    """Show the frames of a bus, until Ctrl-C, or those of a log.

    Args:
        name: address of the bus, file, or `-` for standard input.
        wishes: what the user asked for.
        understand: finds out what is known of the robot; it may take seconds. Called for a live bus in a thread once
            the first frame was heard, so that nothing is set up unnoticed between its answer and that frame.
        say: takes a line of the answer.
        complain: takes what is wrong with the bus or the log.

    Raises:
        ConfigError: there is no such bus, or a file cannot be read or written.
        LinkDown: the bus cannot be opened; the text names the remedy.
    """
    if is_log(name):
        dumping = Dump(wishes, say)
        understanding = understand()
        dumping.begin(understanding)
        try:
            _dump_log(name, dumping, complain)
            tell_unknown(understanding.listener, understanding.manner, complain)
        finally:
            dumping.close()
        return
    run_to_end(_dump_bus(name, wishes, understand, say, complain))


def _dump_log(name: str, dumping: Dump, complain: Callable[[str], None]) -> None:
    reader = FrameReader()
    for line in reader.read(name):
        dumping.show(line)
        if dumping.finished:
            return
    reader.tell(name, complain)


async def _dump_bus(
    address: str,
    wishes: DumpOptions,
    understand: Callable[[], Understanding],
    say: Callable[[str], None],
    complain: Callable[[str], None],
) -> None:
    listening = Listening(open_bus(address, node="dump", listen_only=True), complain)
    dumping = Dump(wishes, say)
    channel = address.partition("?")[0].rpartition(":")[2]
    first = asyncio.Event()

    def heard(frame: Frame, at: float) -> None:
        first.set()
        dumping.show(LogLine(at, channel, frame))
        if dumping.finished:
            listening.finish()

    async def begin() -> None:
        await first.wait()
        dumping.begin(await asyncio.to_thread(understand))
        if not dumping.finished:
            await asyncio.get_running_loop().create_future()

    listening.on_frame(heard)
    try:
        await listening.run_with(begin())
    finally:
        dumping.close()
