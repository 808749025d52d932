"""What the frames of a log say: `msbot bus decode`."""

from __future__ import annotations

from collections.abc import Callable

import click

from msbot.cli.bus.frame_log import FrameReader
from msbot.link.can.protocol import CanDecoder, LegacyDecoder, LogLine, show_frame
from msbot.pnp import Overhearer
from msbot.xrce import decompress, is_whole

WORDS_AT = 66
"""Column where the words begin when the frame leaves room."""


def decode_log(name: str, say: Callable[[str], None], complain: Callable[[str], None], *, legacy: bool = False) -> None:
    """Say every frame of a log with what it means; what could not be read is a complaint at the end.

    Args:
        name: the file, or `-` for standard input.
        say: takes a line of the answer.
        complain: takes what is wrong with the log.
        legacy: the bus is one of the thesis' firmware.

    Raises:
        ConfigError: the log cannot be read.
    """
    reader = FrameReader()
    explain = Overhearer().explain
    decoder = LegacyDecoder(explain, is_whole) if legacy else CanDecoder(explain, decompress=decompress)
    for line in reader.read(name):
        for text in decoded_lines(line, decoder.decode(line.frame, line.at or 0.0)):
            say(text)
    if reader.unreadable:
        complain(
            f"{reader.unreadable} of {reader.frames + reader.unreadable} lines were no frames; {reader.first_problem}"
        )


def decoded_lines(line: LogLine, words: list[str]) -> list[str]:
    """A frame as candump shows it, with words beside it, and below them what the whole packet says."""
    time = "" if line.at is None else f"({line.at:017.6f})  "
    shown = f" {time}{line.channel}  {show_frame(line.frame)}"
    first, *others = words
    return [f"{shown.ljust(WORDS_AT)}  {first}", *(" " * (WORDS_AT + 6) + other for other in others)]


def complain(text: str) -> None:
    """Say something that is not part of the answer."""
    click.echo(f"msbot: {text}", err=True)
