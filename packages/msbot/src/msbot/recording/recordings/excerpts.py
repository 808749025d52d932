"""Makes one recording out of others: of a ring's files, or of a piece of a longer one."""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import field
from pathlib import Path
from typing import Final

from mcap.records import Channel
from mcap.writer import Writer

from msbot.recording.recorder.bag import PROFILE
from msbot.recording.recorder.new_file import new_file, whole_or_none
from msbot.recording.recordings.conversions import ChannelKey, RosView, channel_key
from msbot.recording.recordings.mcap_reader import FRAMES, OWN, Decoder, RecordedMessage, RecordingReader
from msbot.recording.recordings.summary import line_of
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

MOMENTS: Final = (f"{OWN}acts", f"{OWN}measured")
"""Topics that say what happened at a moment, and nothing that is so from then on."""


@dataclass(slots=True)
class Cut:
    """What became of it."""

    messages: int = 0
    first_ns: int | None = None
    last_ns: int | None = None
    left_out: Counter[str] = field(default_factory=Counter)
    """Messages by topic, of topics with something that is no ROS 2 message, if only those were asked for."""
    damages: Mapping[str, str] = field(default_factory=dict)
    """Name of a source -> what could not be read of it, in words."""


def write_cut(
    sources: Iterable[Path],
    target: Path,
    *,
    from_ns: int | None = None,
    to_ns: int | None = None,
    wanted: Callable[[RecordedMessage], bool] = lambda _: True,
    ros: bool = False,
) -> Cut:
    """Write the messages of some recordings, in this order, to a new one.

    What was known when the cut begins is at its beginning, with the time at which it happened: the last sample of each
    topic, and the states since the beginning of the file in which the cut begins.

    Args:
        sources: the recordings.
        target: the new one.
        from_ns: since when; None: since their beginning.
        to_ns: until when; None: until their end.
        wanted: which messages.
        ros: only ROS 2 messages, in a file that ROS 2's own programs read.

    Raises:
        ConfigError: a source is no recording, or the target exists or cannot be written.
    """
    cut = Cut()
    try:
        with whole_or_none(target), new_file(target) as stream:
            copier = _Copier(Writer(stream), cut, ros=ros)
            copier.start()
            damages = {}
            for path in sources:
                reader = RecordingReader(path)
                for message in reader.messages():
                    if wanted(message):
                        copier.take(message, from_ns, to_ns)
                if reader.damage:
                    damages[path.name] = reader.damage
            cut.damages = damages
            copier.finish(from_ns)
    except FileExistsError:
        raise ConfigError(f"{target} is there already: give the recording another name") from None
    except OSError as error:
        raise ConfigError(f"cannot write {target}: {error.strerror or error}") from None
    return cut


class _Copier:
    def __init__(self, writer: Writer, cut: Cut, *, ros: bool) -> None:
        self._writer = writer
        self._cut = cut
        self._ros = RosView() if ros else None
        self._channels: dict[ChannelKey, int] = {}
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._before: dict[tuple[ChannelKey, int, bytes], RecordedMessage] | None = {}
        """What was known before the cut begins; None: it has begun."""

    def start(self) -> None:
        self._writer.start(PROFILE if self._ros else "", "msbot")

    def take(
        self,
        message: RecordedMessage,
        from_ns: int | None,
        to_ns: int | None,
    ) -> None:
        if to_ns is not None and message.at_ns > to_ns:
            return
        if self._ros is not None:
            shown = self._ros.to_ros(message)
            if shown is None:
                self._cut.left_out[message.topic] += 1
                return
            message = shown
        is_early = message.is_repeated or (from_ns is not None and message.at_ns < from_ns)
        if not is_early:
            self._begin(message.logged_ns if from_ns is None else from_ns)
            self._write(message, message.at_ns)
            self._cut.messages += 1
            self._cut.first_ns = message.at_ns if self._cut.first_ns is None else self._cut.first_ns
            self._cut.last_ns = message.at_ns
        elif self._before is not None and message.topic not in MOMENTS:
            # Of a state there may be several keys, which the file does not tell apart: all are kept, also of one time.
            key = channel_key(message)
            is_state = message.channel.message_encoding == "json"
            self._before[key, message.at_ns if is_state else 0, message.data if is_state else b""] = message

    def finish(self, from_ns: int | None) -> None:
        """Write the end of the file."""
        if self._before:
            self._begin(from_ns if from_ns is not None else max(one.logged_ns for one in self._before.values()))
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _begin(self, at_ns: int) -> None:
        if self._before is not None:
            before, self._before = self._before, None
            for message in sorted(before.values(), key=lambda one: one.at_ns):
                self._write(message, at_ns)

    def _write(self, message: RecordedMessage, logged_ns: int) -> None:
        key = channel_key(message)
        if key not in self._channels:
            self._channels[key] = self._declare(message.channel, message)
        self._writer.add_message(self._channels[key], logged_ns, message.data, message.at_ns)

    def _declare(self, channel: Channel, message: RecordedMessage) -> int:
        schema = 0
        if message.schema is not None:
            known = (message.schema.name, message.schema.encoding, message.schema.data)
            if known not in self._schemas:
                self._schemas[known] = self._writer.register_schema(*known)
            schema = self._schemas[known]
        return self._writer.register_channel(
            channel.topic,
            channel.message_encoding,
            schema,
            channel.metadata,
        )


# What happened in one recording and not in another.


HAPPENINGS: Final = (f"{OWN}events", f"{OWN}acts", f"{OWN}stop")
_TIME: Final = re.compile(r"\d+(?:\.\d+)?(?= ?(?:s|ms)\b)")
"""A time inside a sentence; two runs are never exactly alike in their times."""


def differences(before: Iterable[RecordedMessage], after: Iterable[RecordedMessage]) -> list[str]:
    """Lines: `- ` only before, `+ ` only after, `~ ` a topic that says more or less; none: the same happened."""
    happened, said = [], []
    for messages in (before, after):
        lines, counts = _read(messages)
        happened.append(lines)
        said.append(counts)
    found = [line for line in difflib.ndiff(happened[0], happened[1]) if line[:2] in ("- ", "+ ")]
    first, second = said
    for topic in sorted(first.keys() | second.keys()):
        if not (first[topic] and second[topic]):
            found.append(f"{'-' if first[topic] else '+'} {topic}: {amount(first[topic] or second[topic], 'sample')}")
    return found


def _read(messages: Iterable[RecordedMessage]) -> tuple[list[str], Counter[str]]:
    decoder = Decoder()
    lines: list[str] = []
    counts: Counter[str] = Counter()
    for message in _fresh(messages):
        if message.topic in HAPPENINGS:
            lines.append(_TIME.sub("...", line_of(message, decoder) or ""))
        elif not message.topic.startswith(OWN):
            counts[message.topic] += 1
    return lines, counts


def _fresh(messages: Iterable[RecordedMessage]) -> Iterator[RecordedMessage]:
    return (one for one in messages if not one.is_repeated and not one.topic.startswith(FRAMES))
