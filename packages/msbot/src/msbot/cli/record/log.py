"""`msbot log`: look into recordings."""

from __future__ import annotations

import csv
import json
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click

from msbot.cli import completers
from msbot.cli.robot_options import robot_options
from msbot_agent.cli.exit_status import ExitStatus
from msbot_agent.cli.options import FiniteRange, WholeRange
from msbot_agent.text.sentence import as_cell, printable
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

if TYPE_CHECKING:
    from msbot.recording.recordings.mcap_reader import RecordedMessage, RecordingReader


# Names of recordings that a command writes.


SUFFIX = ".mcap"


def recording_name(file: Path) -> Path:
    """The file of that name: a name without an ending gets that of recordings.

    Raises:
        ConfigError: it has the ending of something else, which a recording is not, or is a folder.
    """
    if not file.name or file.name == ".." or file.is_dir():
        raise ConfigError(f"{file} is a folder: name a file in it, for example {file / 'lesson'}{SUFFIX}")
    if file.suffix.lower() == SUFFIX:
        return file
    if file.suffix:
        raise ConfigError(
            f"{file}: a recording is an MCAP file, and its name ends in {SUFFIX}: {file.with_suffix(SUFFIX)} "
            "(tables are made of it by `msbot log export`)"
        )
    return file.with_name(f"{file.name}{SUFFIX}")


MOST_NAMES = 30
"""So many topics or slots are named in an error."""

_C = TypeVar("_C", bound=Callable[..., object])


class _LogGroup(click.Group):
    """Takes `msbot log --follow` for `msbot log follow`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        return super().parse_args(ctx, ["follow", *args[1:]] if args[:1] in (["--follow"], ["-f"]) else args)


@click.group("log", cls=_LogGroup)
def command() -> None:
    """Show, cut and compare recordings (.mcap); write them as tables or frames.

    Without a file: `msbot log --follow` prints what happens in the robot that runs here.
    """


@command.command("follow")
@click.option("-n", "--lines", type=WholeRange(0, 200), default=10, show_default=True, help="Begin with so many lines.")
@click.option("--slot", "slots", multiple=True, help="Only this slot; repeatable.")
@click.option("--once", is_flag=True, help="End after these lines.")
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object for each line.")
@robot_options
def follow(db: str | None, robot: str | None, *, lines: int, slots: tuple[str, ...], once: bool, as_json: bool) -> None:
    """Print what happens in the robot that runs here, line by line, until Ctrl-C."""
    from msbot.cli.record.follow import follow_log

    follow_log(db, robot, last=lines, slots=slots, goes_on=not once, as_json=as_json)


@dataclass(slots=True)
class _Wish:
    """Which messages a person wants to see."""

    topics: tuple[str, ...]
    slots: tuple[str, ...]
    from_s: float | None
    to_s: float | None
    _topics_seen: set[str] = field(default_factory=set)
    _slots_seen: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        if self.from_s is not None and self.to_s is not None and self.to_s < self.from_s:
            raise ConfigError(f"nothing lies from {self.from_s:g} s to {self.to_s:g} s: --to must not be before --from")

    def has(self, message: RecordedMessage) -> bool:
        """Whether topic and slot are wanted."""
        topic, slot = message.topic.strip("/"), message.slot
        self._topics_seen.add(topic)
        self._slots_seen.add(slot)
        return (not self.topics or any(_is_topic(one, topic) for one in self.topics)) and (
            not self.slots or slot in self.slots
        )

    def mistakes(self, path: Path) -> Iterator[str]:
        """After reading: what was named and is not in the recording, in sentences."""
        for name in self.topics:
            if not any(_is_topic(name, topic) for topic in self._topics_seen):
                yield f"{path} has no topic {name!r}; it has {_listed(self._topics_seen)}"
        for name in self.slots:
            if name not in self._slots_seen:
                yield f"nothing in {path} was said in a slot {name!r}; slots that said something: " + (
                    _listed(self._slots_seen - {""})
                )


def _is_topic(name: str, topic: str) -> bool:
    return name.strip("/") in (topic, topic.partition("/")[0])


def _listed(names: set[str]) -> str:
    return printable(", ".join(sorted(names)[:MOST_NAMES])) + (", ..." if len(names) > MOST_NAMES else "") or "none"


def _choice(function: _C) -> _C:
    """The options that choose messages."""
    for option in (
        click.option("--to", "to_s", type=FiniteRange(), metavar="SECONDS", help="Until this time in the recording."),
        click.option(
            "--from", "from_s", type=FiniteRange(), metavar="SECONDS", help="From this time in the recording on."
        ),
        click.option("--slot", "slots", multiple=True, help="Only the part in this slot."),
        click.option(
            "--topic",
            "topics",
            multiple=True,
            metavar="TOPIC",
            help="Only this topic, or all below it (msbot); repeatable.",
        ),
    ):
        function = option(function)
    return function


_file = click.argument("file", shell_complete=completers.recordings, type=click.Path(path_type=Path))


@command.command("show")
@_file
@_choice
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object for each message.")
def show(
    file: Path,
    topics: tuple[str, ...],
    slots: tuple[str, ...],
    from_s: float | None,
    to_s: float | None,
    *,
    as_json: bool,
) -> None:
    """Print each message of a recording as a line: time, topic, content.

    CAN frames, messages of the inventory (msbot_inventory_Request) and samples that cannot be decoded appear only
    if their topic is named.
    """
    from msbot.recording.recorder.batch import INVENTORY_TOPICS
    from msbot.recording.recordings.mcap_reader import FRAMES, Decoder, RecordingReader
    from msbot.recording.recordings.summary import frame_of, line_of, unread_words
    from msbot_agent.link.can.protocol import format_frame

    decoder, reader = Decoder(), RecordingReader(file)
    wish = _Wish(topics, slots, from_s, to_s)
    unread: Counter[str] = Counter()
    for at_s, message in _chosen(reader, wish):
        frame = frame_of(message)
        fields = decoder.fields(message)
        if not wish.topics:
            if frame is not None or (fields is not None and message.topic.startswith(INVENTORY_TOPICS)):
                continue
            if fields is None or message.topic.startswith(FRAMES):  # octets that are no frame
                unread[message.topic] += 1
                continue
        line = format_frame(frame) if frame else line_of(message, decoder) or ""
        if as_json:
            known = json.dumps(
                {
                    "at_ns": message.at_ns,
                    "at_s": at_s,
                    "topic": message.topic,
                    "slot": message.slot,
                    "words": line,
                    "fields": fields,
                },
                default=_octets,
            )
            click.echo(known)
        else:
            click.echo(f"{at_s:10.3f}  {printable(message.topic)}  {printable(line)}")
    _tell_unread(unread_words(unread))
    _tell_rest(wish.mistakes(file), _damage_of(reader))


@command.command("filter")
@_file
@click.argument("target", type=click.Path(path_type=Path))
@_choice
@click.option("--ros2", "ros", is_flag=True, help="Only what ROS 2 can read, for `ros2 bag` and rosbags.")
def filter_(  # noqa: PLR0917 - what the command was given
    file: Path,
    target: Path,
    topics: tuple[str, ...],
    slots: tuple[str, ...],
    from_s: float | None,
    to_s: float | None,
    *,
    ros: bool,
) -> None:
    """Write a section of a recording; it begins with the state at that moment."""
    from msbot.recording.recordings.excerpts import write_cut
    from msbot.recording.recordings.mcap_reader import began_ns
    from msbot.recording.recordings.summary import named_topics

    target = recording_name(target)
    wish = _Wish(topics, slots, from_s, to_s)
    zero_ns = began_ns(file)
    cut = write_cut(
        [file],
        target,
        from_ns=None if from_s is None else zero_ns + round(from_s * 1e9),
        to_ns=None if to_s is None else zero_ns + round(to_s * 1e9),
        wanted=wish.has,
        ros=ros,
    )
    click.echo(f"{target}: {amount(cut.messages, 'message')}")
    if cut.left_out:
        click.echo(f"left out, for they are no ROS 2 messages: {named_topics(cut.left_out)}")
    _tell_rest(wish.mistakes(file), [f"{name} is damaged: {damage}" for name, damage in cut.damages.items()])


@command.command("diff")
@click.argument("before", shell_complete=completers.recordings, type=click.Path(path_type=Path))
@click.argument("after", shell_complete=completers.recordings, type=click.Path(path_type=Path))
def diff(before: Path, after: Path) -> None:
    """Show what parts and people did in only one of two recordings, and compare the topics.

    Times are not compared. Exit status 1: they differ, or one is damaged.
    """
    from msbot.recording.recordings.excerpts import differences
    from msbot.recording.recordings.mcap_reader import RecordingReader

    first, second = RecordingReader(before), RecordingReader(after)
    lines = differences(first.messages(), second.messages())
    for line in lines:
        click.echo(printable(line))
    if not lines:
        click.echo("The same happened in both.")
    _tell_rest((), (*_damage_of(first), *_damage_of(second)))
    sys.exit(ExitStatus.NO if lines else ExitStatus.DONE)


@command.command("export")
@_file
@click.argument("target", type=click.Path(path_type=Path))
@_choice
def export(  # noqa: PLR0917 - what the command was given
    file: Path, target: Path, topics: tuple[str, ...], slots: tuple[str, ...], from_s: float | None, to_s: float | None
) -> None:
    """Write the values of a recording as a table (.csv, .parquet), or its CAN frames (.log, .asc, .blf, .trc)."""
    from msbot.cli.bus.frame_log import FRAME_FORMATS
    from msbot.recording.recorder.new_file import whole_or_none
    from msbot.recording.recordings.mcap_reader import RecordingReader

    if target.exists():
        raise ConfigError(f"{target} is there already: give the file another name")
    wish, form = _Wish(topics, slots, from_s, to_s), target.suffix.lower()
    if form not in {".csv", ".parquet", *FRAME_FORMATS}:
        frames = ", ".join(one for one in FRAME_FORMATS if one != ".csv")
        raise ConfigError(
            f"cannot write {target}: its ending names no format; there are .csv and .parquet for values, "
            f"and for CAN frames {frames}"
        )
    reader = RecordingReader(file)
    with whole_or_none(target):
        match form:
            case ".csv":
                words = amount(_export_table(reader, target, wish), "value")
            case ".parquet":
                words = amount(_export_parquet(reader, target, wish), "value")
            case _:
                words = amount(_export_frames(reader, target, wish), "frame")
    click.echo(f"{target}: {words}")
    _tell_rest(wish.mistakes(file), _damage_of(reader))


def _export_parquet(reader: RecordingReader, target: Path, wish: _Wish) -> int:
    from msbot.recording.recordings.conversions import write_parquet
    from msbot.recording.recordings.summary import unread_words

    unread: Counter[str] = Counter()
    count = write_parquet(_chosen(reader, wish), target, unread)
    _tell_unread(unread_words(unread))
    return count


def _export_table(reader: RecordingReader, target: Path, wish: _Wish) -> int:
    from msbot.recording.recorder.batch import OWN_TOPICS
    from msbot.recording.recordings.mcap_reader import Decoder
    from msbot.recording.recordings.summary import rows_of, unread_words

    decoder, count = Decoder(), 0
    unread: Counter[str] = Counter()
    try:
        with target.open("w", newline="", encoding="utf-8") as stream:
            table = csv.writer(stream)
            table.writerow(["time_s", "topic", "slot", "field", "value"])
            for at_s, message in _chosen(reader, wish):
                if not message.topic.startswith(OWN_TOPICS) and decoder.fields(message) is None:
                    unread[message.topic] += 1
                for topic, slot, name, value in rows_of(message, decoder):
                    table.writerow([f"{at_s:.6f}", *map(as_cell, (topic, slot, name, str(value)))])
                    count += 1
    except OSError as error:
        raise ConfigError(f"cannot write {target}: {error.strerror}") from None
    _tell_unread(unread_words(unread))
    return count


def _tell_unread(words: str) -> None:
    if words:
        click.echo(words, err=True)


def _export_frames(reader: RecordingReader, target: Path, wish: _Wish) -> int:
    from msbot.cli.bus.frame_log import FrameWriter
    from msbot.recording.recordings.mcap_reader import FRAMES
    from msbot.recording.recordings.summary import frame_of, named_topics
    from msbot_agent.link.can.protocol import LogLine

    count = 0
    broken: Counter[str] = Counter()
    writer = FrameWriter(target)
    try:
        try:
            for _, message in _chosen(reader, wish):
                frame = frame_of(message)
                if frame is not None:
                    channel = _channel(message.topic.removeprefix(FRAMES))
                    writer.write(LogLine(message.at_ns / 1e9, channel, frame))
                    count += 1
                elif message.topic.startswith(FRAMES):
                    broken[message.topic] += 1
        finally:
            writer.close()
    except OSError as error:
        raise ConfigError(f"cannot write {target}: {error.strerror or error}") from None
    if broken:
        click.echo(f"left out, for they are no frames: {named_topics(broken)}", err=True)
    return count


def _channel(link: str) -> str:
    """The name of a link's bus as candump writes it: `can0` of `can:can0?fd=1`, which `canplayer` finds again."""
    scheme, _, rest = link.partition("?")[0].partition(":")
    name = rest if scheme.startswith("can") else f"{scheme}{rest}"
    return re.sub(r"[^A-Za-z0-9_.-]", "", name) or scheme


def _damage_of(reader: RecordingReader) -> tuple[str, ...]:
    return (f"{reader.path} is damaged: {reader.damage}",) if reader.damage else ()


def _tell_rest(mistakes: Iterable[str], damages: Sequence[str]) -> None:
    """Say what is not in recordings, or could not be read; the exit status tells it to scripts, which read no words."""
    told = [*mistakes, *damages]
    for sentence in told:
        click.echo(f"msbot: {sentence}", err=True)
    if told:
        sys.exit(ExitStatus.NO)


def _chosen(reader: RecordingReader, wish: _Wish) -> Iterator[tuple[float, RecordedMessage]]:
    """The messages that are wanted, with their times in seconds since the recording began."""
    began_ns: int | None = None
    for message in reader.messages():
        began_ns = message.logged_ns if began_ns is None else began_ns
        at_s = (message.logged_ns - began_ns) / 1e9
        if wish.to_s is not None and at_s > wish.to_s:
            continue
        if wish.has(message) and (wish.from_s is None or at_s >= wish.from_s):
            yield at_s, message


def _octets(value: object) -> str:
    return value.hex() if isinstance(value, bytes) else str(value)
