"""What the frames of a log say: `msbot bus decode`."""

from __future__ import annotations

from collections.abc import Callable

from msbot.cli.bus.frame_log import FrameReader
from msbot.cli.bus.telling import Manner, tell_unknown, told_lines
from msbot.pnp import FrameListener


def decode_log(
    name: str, listener: FrameListener, manner: Manner, say: Callable[[str], None], complain: Callable[[str], None]
) -> None:
    """Print every frame of a log with its meaning; what could not be read is reported at the end.

    Args:
        name: the file, or `-` for standard input.
        listener: understands the frames.
        manner: what is said of them.
        say: takes a line of the answer.
        complain: takes what is wrong with the log.

    Raises:
        ConfigError: the log cannot be read.
    """
    reader = FrameReader()
    for line in reader.read(name):
        for text in told_lines(line, listener.hear(line.frame, line.at or 0.0), manner):
            say(text)
    tell_unknown(listener, manner, complain)
    reader.tell(name, complain)
