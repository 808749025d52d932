"""What the recorder's process does with records: a ring of files, and one more file while somebody wants it.

Sans-IO but for the files themselves: time comes with each call.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

from msbot.recording.recorder.batch import Item, Kind, RecordedChannel, encode_object, split_state
from msbot.recording.recorder.recording_file import RecordingFile, RingLimits, Segment, segment_name, segments, too_old
from msbot_agent.process.user_folders import make_own_folder

if TYPE_CHECKING:
    from msbot.recording.recorder.bag import Bag

MOST_STATES: Final = 5_000
"""Keys of states that are remembered for the beginning of the next file."""
LARGEST_KNOWN: Final = 4_096
"""Octets of the largest sample that is repeated at the beginning of a file."""
RETRY_S: Final = 5.0
NS: Final = 1_000_000_000


class Storing:
    """Writes records to the ring and, between START and STOP, to another file.

    Args:
        folder: where the ring is; None: there is none.
        limits: how much it keeps.
        say: takes what people should know: a pair of file and trouble; an empty trouble: it is well again.
        on_left_out: takes topics that cannot be in a bag, as soon as something of them was left out: file and topics.
        on_end: takes a file that was begun by START or START_BAG and gets nothing more.
    """

    def __init__(
        self,
        folder: Path | None,
        limits: RingLimits,
        say: Callable[[str, str], None],
        *,
        on_left_out: Callable[[str, list[str]], None] = lambda *_: None,
        on_end: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._folder = folder
        self._limits = limits
        self._say = say
        self._on_left_out = on_left_out
        self._on_end = on_end
        self._channels: dict[int, RecordedChannel] = {}
        self._states: dict[tuple[int, bytes], tuple[int, bytes]] = {}
        self._samples: dict[int, tuple[int, bytes]] = {}
        self._ring: RecordingFile | None = None
        self._extra: RecordingFile | Bag | None = None
        self._number = 0
        self._left_out = 0
        self._retry_at: float | None = None
        self._in_trouble: set[str] = set()
        self._now_ns = 0

    def take(self, item: Item, now: float) -> None:
        """One record; `now` is a monotonic time in seconds."""
        kind, number, at_ns, content = item
        self._now_ns = max(self._now_ns, at_ns)
        if kind == Kind.CHANNEL:
            self._channels[number] = RecordedChannel.decode(content)
        elif kind in {Kind.START, Kind.START_BAG}:
            self._start(Path(content.decode()), at_ns, as_bag=kind == Kind.START_BAG)
        elif kind == Kind.STOP:
            self._end_extra()
        elif number not in self._channels:
            self._left_out += 1  # said before this process was told of its channel
        else:
            self._to_ring(item, now)
            if self._extra is not None:
                self._to_extra(item)
            self._remember(kind, number, at_ns, content)  # last: a file that has just begun would have it twice

    def flush(self, now: float) -> None:
        """Hand over to the system what has come, and begin a new file of the ring when it is time."""
        ring = self._ring
        if ring is not None:
            try:
                ring.flush()
                age_s = (self._now_ns - ring.began_ns) / NS
                if age_s >= self._limits.segment_s or ring.octets >= self._limits.segment_octets:
                    ring.close()
                    self._ring = None
            except OSError as error:
                self._ring_failed(error, now)
        if self._extra is not None:
            try:
                self._extra.flush()
                self._tell_unfit(self._extra)
            except OSError as error:
                self._extra_failed(error)

    def close(self) -> None:
        """End all files properly."""
        if self._ring is not None:
            try:
                self._ring.close()
            except OSError as error:
                self._trouble(self._ring, error)
                self._ring.drop()
            self._ring = None
        self._end_extra()

    def _remember(self, kind: int, number: int, at_ns: int, content: bytes) -> None:
        if kind == Kind.SAMPLE and len(content) <= LARGEST_KNOWN:
            self._samples[number] = (at_ns, content)
        elif kind == Kind.STATE:
            key = (number, split_state(content)[0])
            self._states.pop(key, None)
            self._states[key] = (at_ns, content)
            if len(self._states) > MOST_STATES:
                del self._states[next(iter(self._states))]

    def _to_ring(self, item: Item, now: float) -> None:
        if self._folder is None:
            return
        if self._ring is None and not self._open_ring(item[2], now):
            self._left_out += 1
            return
        assert self._ring is not None
        try:
            self._write(self._ring, item)
        except OSError as error:
            self._left_out += 1
            self._ring_failed(error, now)

    def _open_ring(self, at_ns: int, now: float) -> bool:
        if self._retry_at is not None and now < self._retry_at:
            return False
        assert self._folder is not None
        self._make_room()
        path = self._folder / segment_name(at_ns, self._number)
        try:
            make_own_folder(self._folder)
            self._ring = RecordingFile(path, at_ns)
            self._write_known(self._ring, at_ns)
            self._number += 1
            if self._left_out:
                self._tell_left_out(self._ring, at_ns)
            self._ring.flush()
        except OSError as error:
            self._ring_failed(error, now)
            return False
        self._retry_at = None
        self._well(self._folder)
        return True

    def _write_known(self, file: RecordingFile | Bag, at_ns: int) -> None:
        """Begin a new file with what was last known."""
        known = [(number, Kind.STATE, when, content) for (number, _), (when, content) in self._states.items()]
        known += [(number, Kind.SAMPLE, when, content) for number, (when, content) in self._samples.items()]
        for number, kind, when, content in sorted(known, key=lambda one: one[2]):
            self._write(file, (kind, number, when, content), at_ns)

    def _write(self, file: RecordingFile | Bag, item: Item, logged_ns: int | None = None) -> None:
        kind, number, at_ns, content = item
        if not file.has(number):
            file.declare(number, self._channels[number])
        file.write(kind, number, at_ns, content, logged_ns)

    def _tell_left_out(self, file: RecordingFile, at_ns: int) -> None:
        number = next((n for n, channel in self._channels.items() if channel.topic == "/msbot/recorder"), None)
        if number is not None:
            words = {"left_out": self._left_out, "why": "they could not be written"}
            self._write(file, (Kind.OBJECT, number, at_ns, encode_object(words)))
            self._left_out = 0

    def _make_room(self) -> None:
        """Delete what the ring need not keep."""
        for path in too_old(self._segments(), self._limits, self._now_ns / NS):
            self._delete(path)

    def _segments(self) -> list[Segment]:
        assert self._folder is not None
        current = None if self._ring is None else self._ring.path
        try:
            return [segment for segment in segments(self._folder) if segment.path != current]
        except OSError:
            return []  # there is no folder yet; if it cannot be made, that is told

    def _delete(self, path: Path) -> None:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            self._say(str(path), f"cannot be deleted: {error.strerror}")

    def _ring_failed(self, error: OSError, now: float) -> None:
        assert self._folder is not None
        if self._ring is not None:
            self._ring.drop()
            self._ring = None
        if older := self._segments():
            self._delete(older[0].path)  # what is newest is worth more
        self._retry_at = now + RETRY_S
        self._told(self._folder, error)

    def _start(self, path: Path, at_ns: int, *, as_bag: bool) -> None:
        self._end_extra()
        self._in_trouble.discard(str(path))  # somebody waits to hear how it goes this time
        try:
            self._extra = _new_bag(path, at_ns) if as_bag else RecordingFile(path, at_ns)
            self._write_known(self._extra, at_ns)
            self._extra.flush()
            self._tell_unfit(self._extra)
            self._well(path)
        except OSError as error:
            self._extra = None
            self._told(path, error)

    def _to_extra(self, item: Item) -> None:
        assert self._extra is not None
        try:
            self._write(self._extra, item)
        except OSError as error:
            self._extra_failed(error)

    def _extra_failed(self, error: OSError) -> None:
        assert self._extra is not None
        self._extra.drop()
        self._trouble(self._extra, error)
        self._extra = None

    def _end_extra(self) -> None:
        if self._extra is not None:
            try:
                self._extra.close()
                self._tell_unfit(self._extra)
            except OSError as error:
                self._trouble(self._extra, error)
            self._on_end(str(self._extra.path))
            self._extra = None

    def _tell_unfit(self, file: RecordingFile | Bag) -> None:
        """Name what cannot be in a bag."""
        if not isinstance(file, RecordingFile) and (topics := file.take_left_out()):
            self._on_left_out(str(file.path), topics)

    def _trouble(self, file: RecordingFile | Bag, error: OSError) -> None:
        self._told(file.path, error)

    def _told(self, what: Path, error: OSError) -> None:
        if str(what) not in self._in_trouble:
            self._in_trouble.add(str(what))
            self._say(str(what), f"cannot be written: {error.strerror or error}")

    def _well(self, what: Path) -> None:
        if str(what) in self._in_trouble:
            self._in_trouble.discard(str(what))
            self._say(str(what), "")


def _new_bag(path: Path, at_ns: int) -> Bag:
    from msbot.recording.recorder.bag import Bag  # with the robot's messages, which no other recording needs here

    return Bag(path, at_ns)
