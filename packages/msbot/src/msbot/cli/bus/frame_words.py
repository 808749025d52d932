"""How `msbot bus dump` and `decode` tell what a frame says: in sentences, in the words of the protocol, or as JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from enum import Enum, auto
from pathlib import Path
from typing import TYPE_CHECKING

from msbot.cli.bus.foreign_frames import foreign_words
from msbot.cli.database_place import DEFAULT_BLUEPRINT
from msbot.pnp import KNOWN_TYPES, FrameListener, FrameWords, SessionListener
from msbot_agent.link.can.protocol import LogLine, format_frame, show_frame
from msbot_agent.text.untrusted_input import open_input_file
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from msbot.cli.bus.bus_source import RobotOnBus
    from msbot.config import Library


WORDS_AT = 66
"""Column where the words begin when the frame leaves room."""


class WordsFormat(Enum):
    """What is shown of what a frame says."""

    PROTOCOL = auto()
    """The words of the protocol."""
    PLAIN = auto()
    """A sentence."""
    BOTH = auto()
    """The sentence, below it the words of the protocol."""
    JSON = auto()
    """Both, one JSON object for each frame."""


def words_format(*, is_known: bool, protocol: bool, as_json: bool) -> WordsFormat:
    """What is shown: unless the robot is known there are no sentences to be shown alone."""
    if as_json:
        return WordsFormat.JSON
    if not is_known:
        return WordsFormat.PROTOCOL
    return WordsFormat.BOTH if protocol else WordsFormat.PLAIN


def library_of(blueprint: Path | None, folders: Sequence[Path], complain: Callable[[str], None]) -> Library | None:
    """The part library of the robot whose bus it is; None: nobody said which robot, and there is no robot.toml here.

    Args:
        blueprint: the robot's blueprint, if it was named.
        folders: more part types.
        complain: takes what is wrong with a robot.toml that only lies here: a bus is shown all the same.

    Raises:
        ConfigError: what was named cannot be read, or is wrong.
    """
    path = blueprint or DEFAULT_BLUEPRINT
    if blueprint is not None:
        try:
            open_input_file(blueprint).close()
        except OSError as error:
            raise ConfigError(f"{blueprint}: cannot be read ({error.strerror}); name the robot's blueprint") from None
    if not folders and not path.is_file():
        return None
    from msbot.config import library_folders, load_library

    try:
        return load_library(*library_folders(path), *folders)
    except ConfigError as error:
        if blueprint is not None or folders:
            raise
        complain(f"no sentences, because the robot.toml here cannot be used: {error}")
        return None


def listener_for(library: Library | None, *, legacy: bool, robot: RobotOnBus | None = None) -> FrameListener:
    """A listener that knows the message types of a robot; without one, those that every robot has.

    Args:
        library: the robot's part library, when its blueprint is known.
        legacy: the frames are those of the thesis' firmware.
        robot: what a running master knows of the bus; its types are those in force.
    """
    if library is None and robot is None:
        return FrameListener(legacy=legacy, foreign=foreign_words())
    from msbot.sim import message_class

    types = {**({} if library is None else library.messages), **({} if robot is None else robot.types)}

    def units(type_name: str) -> Mapping[str, str]:
        return types[type_name].units if type_name in types else {}

    classes = map(message_class, types.values())
    know = None if robot is None else robot.learn_object
    return FrameListener(
        SessionListener((*KNOWN_TYPES, *classes), know=know, units=units), legacy=legacy, foreign=foreign_words()
    )


def told_lines(line: LogLine, words: FrameWords, manner: WordsFormat) -> list[str]:
    """A frame and what it says, as lines to be printed."""
    match manner:
        case WordsFormat.JSON:
            return [_as_json(line, words)]
        case WordsFormat.PROTOCOL:
            return _beside(line, words.protocol)
        case WordsFormat.PLAIN:
            return _beside(line, words.plain or words.about)
        case WordsFormat.BOTH:
            return _beside(line, (*(words.plain or words.about), *words.protocol))


def tell_unknown(listener: FrameListener, manner: WordsFormat, complain: Callable[[str], None]) -> None:
    """At the end of a log: which samples have no sentence, where sentences are shown."""
    if listener.unknown and manner in (WordsFormat.PLAIN, WordsFormat.BOTH):
        samples = amount(listener.unknown, "sample has", "samples have")
        complain(f"{samples} no sentence: their parts had joined before the log begins")


def _beside(line: LogLine, words: Sequence[str]) -> list[str]:
    """A frame as candump shows it, with words beside it, and below them the others."""
    time = "" if line.at is None else f"({line.at:017.6f})  "
    shown = f" {time}{line.channel}  {show_frame(line.frame)}"
    first, *others = words or ("",)
    return [f"{shown.ljust(WORDS_AT)}  {first}", *(" " * (WORDS_AT + 6) + other for other in others)]


def _as_json(line: LogLine, words: FrameWords) -> str:
    frame = format_frame(line.frame)
    head = {"at_s": line.at, "channel": line.channel, "frame": frame}
    return json.dumps({**head, "plain": words.plain, "about": words.about, "protocol": words.protocol})
