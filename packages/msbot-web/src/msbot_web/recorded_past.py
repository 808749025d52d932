"""The past of a robot, out of its recorder's ring or a copy: read by another process, so that no disk is waited for."""

from __future__ import annotations

import asyncio
import tempfile
from collections import OrderedDict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from msbot.config import Library
from msbot.process.persistent_worker import PersistentWorker
from msbot.process.worker_pool import TooMuchWork, WorkerPool, WorkLimits
from msbot.recording.curves.curve_reader import ReadCurves, read_curves, ring_files
from msbot.recording.recorder.recording_file import file_began_s
from msbot.recording.recordings.bounded_copy import BoundedCopy, bounded_copy
from msbot.recording.recordings.mcap_reader import NS, RecordedMessage, RecordingReader
from msbot_agent.text.sentence import said
from msbot_web.recorded_snapshot import HISTORY_S, KnownEndpoint, RecordedSnapshot, SnapshotBuilder
from msbot_xrce.errors import ConfigError

LIMITS = WorkLimits(cpu_s=20, memory_mb=900, wall_s=60.0)
MOST_POINTS = 1500
"""Points of each curve that a page draws."""
STEP_S: Final = 0.1
"""Moments that are nearer to each other than this are the same one."""
MOST_MOMENTS: Final = 40
"""Moments that are remembered."""
SILENCE_S: Final = 5.0
"""The recorder notes something every second; after a longer silence it did not run."""
JUST_NOW_S: Final = 0.8
"""After this time the last moment is in the ring's files."""
LARGEST_COPY: Final = 2 << 20
"""Octets of a copy that is kept with somebody's work."""
REMEMBERED_FILES: Final = 3
LARGEST_REMEMBERED: Final = 4 << 20
"""Octets of a file whose content the other process remembers."""


class RecordedPast:
    """What the recorder has.

    Args:
        folder: where its ring is; empty: this robot is not recorded.
        library: what part numbers and message types mean.
        endpoints: what is known of the objects of parts on CAN buses.
    """

    def __init__(
        self,
        folder: Callable[[], str],
        library: Callable[[], Library],
        endpoints: Callable[[], Sequence[KnownEndpoint]],
    ) -> None:
        self._folder = folder
        self._library = library
        self._endpoints = endpoints
        self._workshop = WorkerPool(LIMITS)
        self._kept = PersistentWorker(LIMITS)
        self._moments: OrderedDict[int, asyncio.Task[RecordedSnapshot]] = OrderedDict()
        """By tenths of a second: what was read, or is being read."""

    async def curves(self, names: Sequence[str], from_s: float, to_s: float) -> ReadCurves:
        """Curves between two times, seconds since 1970.

        Raises:
            ConfigError: the robot is not recorded, or it takes too long.
        """
        try:
            return await self._workshop.run(read_ring, self._place(), tuple(names), from_s, to_s)
        except TooMuchWork:
            raise ConfigError(said("so much of the past takes too long to read: choose a shorter time")) from None

    async def snapshot_at(self, at_s: float) -> RecordedSnapshot:
        """The whole robot at a time, seconds since 1970; whoever else looks at it gets the same.

        Raises:
            ConfigError: the robot is not recorded, or was not then, or it takes too long.
        """
        folder, number = self._place(), round(at_s / STEP_S)
        task = self._moments.get(number)
        if task is None:
            task = asyncio.get_running_loop().create_task(self._read(folder, number * STEP_S))
            task.add_done_callback(lambda done: done.cancelled() or done.exception())  # also if nobody waits any more
            self._moments[number] = task
            while len(self._moments) > MOST_MOMENTS:
                self._moments.popitem(last=False)
        self._moments.move_to_end(number)
        try:
            return await asyncio.shield(task)  # whoever leaves does not take it from others
        except ConfigError:
            self._moments.pop(number, None)  # it may go better the next time
            raise

    async def begin_s(self) -> float | None:
        """When the ring begins, seconds since 1970; None: there is nothing in it.

        Raises:
            ConfigError: the robot is not recorded.
        """
        return await asyncio.to_thread(ring_begin_s, self._place())

    async def copy(self, from_s: float, to_s: float) -> BoundedCopy | None:
        """What the ring has of a time, without frames; of more than fits, the end. None: it has nothing.

        Raises:
            ConfigError: the robot is not recorded, or it takes too long.
        """
        folder = self._place()
        await asyncio.sleep(JUST_NOW_S)
        try:
            return await self._workshop.run(copy_of_ring, folder, from_s, to_s, LARGEST_COPY)
        except TooMuchWork:
            raise ConfigError(said("so much of the past takes too long to read: choose a shorter time")) from None

    async def moment_of_copy(self, name: str, octets: bytes, at_s: float) -> RecordedSnapshot:
        """The robot at a time that a copy has.

        Args:
            name: what tells this copy from others.
            octets: the copy.
            at_s: seconds since 1970.

        Raises:
            ConfigError: the copy has nothing of that time, or it takes too long.
        """
        try:
            return await self._kept.run(
                read_moment_of_copy, name, octets, at_s, self._library(), tuple(self._endpoints())
            )
        except TooMuchWork:
            raise ConfigError(said("so much of the past takes too long to read: choose another moment")) from None

    async def _read(self, folder: str, at_s: float) -> RecordedSnapshot:
        try:
            return await self._kept.run(read_moment, folder, at_s, self._library(), tuple(self._endpoints()))
        except TooMuchWork:
            raise ConfigError(said("so much of the past takes too long to read: choose another moment")) from None

    def _place(self) -> str:
        folder = self._folder()
        if not folder:
            raise ConfigError(said("this robot runs with `--rec off`: nothing of its past is known"))
        return folder


def read_ring(folder: str, names: Sequence[str], from_s: float, to_s: float) -> ReadCurves:
    """What the other process does for curves."""
    files = ring_files(Path(folder), from_s, to_s)
    return read_curves(files, names, from_s=from_s, to_s=to_s, most_points=MOST_POINTS)


def copy_of_ring(folder: str, from_s: float, to_s: float, most_octets: int) -> BoundedCopy | None:
    """What the other process does for a copy."""
    return bounded_copy(ring_files(Path(folder), from_s, to_s), from_s, to_s, most_octets)


def ring_begin_s(folder: str) -> float | None:
    """When the oldest file of a ring begins; its name has whole seconds."""
    files = ring_files(Path(folder))
    return None if not files else file_began_s(files[0].name)


def read_moment(folder: str, at_s: float, library: Library, endpoints: Sequence[KnownEndpoint]) -> RecordedSnapshot:
    """What the other process does for a moment.

    Raises:
        ConfigError: nothing was recorded then.
    """
    at_ns = round(at_s * NS)
    earlier: Sequence[RecordedMessage] = ()
    present: Sequence[RecordedMessage] = ()
    for path in ring_files(Path(folder), at_s - HISTORY_S, at_s):
        found = _messages(path, at_ns)
        if found and found[0].logged_ns <= at_ns:
            earlier, present = (*earlier, *present), found
    return _snapshot(at_ns, present, earlier, library, endpoints)


def read_moment_of_copy(
    name: str, octets: bytes, at_s: float, library: Library, endpoints: Sequence[KnownEndpoint]
) -> RecordedSnapshot:
    """What the other process does for a moment of a copy.

    Raises:
        ConfigError: nothing was recorded then.
    """
    key = Path(name)
    known = _remembered.get(key)
    if known is None or known[0] != len(octets):
        with tempfile.TemporaryDirectory(prefix="msbot-copy-") as place:
            file = Path(place, "copy.mcap")
            file.write_bytes(octets)
            known = (len(octets), tuple(RecordingReader(file).messages()))
        _remember(key, *known)
    return _snapshot(round(at_s * NS), known[1], (), library, endpoints)


def _snapshot(
    at_ns: int,
    present: Sequence[RecordedMessage],
    earlier: Sequence[RecordedMessage],
    library: Library,
    endpoints: Sequence[KnownEndpoint],
) -> RecordedSnapshot:
    latest_ns = max((one.at_ns for one in present if one.at_ns <= at_ns and not one.is_repeated), default=0)
    if at_ns - latest_ns > SILENCE_S * NS:
        raise ConfigError(said("nothing was recorded at that time: the recorder or the robot did not run"))
    return SnapshotBuilder(at_ns, present, earlier, library, endpoints).snapshot()


_remembered: OrderedDict[Path, tuple[int, Sequence[RecordedMessage]]] = OrderedDict()
"""In the other process: the octets that a file had, and its messages."""


def _messages(path: Path, at_ns: int) -> Sequence[RecordedMessage]:
    """The messages of a file, at least up to that time."""
    try:
        size = path.stat().st_size
    except FileNotFoundError:
        return ()  # the recorder has just deleted it
    known = _remembered.get(path)
    if known is not None and (known[0] == size or (known[1] and known[1][-1].logged_ns > at_ns + NS)):
        _remembered.move_to_end(path)
        return known[1]
    found = tuple(RecordingReader(path).messages())
    if size <= LARGEST_REMEMBERED:
        _remember(path, size, found)
    return found


def _remember(path: Path, size: int, found: Sequence[RecordedMessage]) -> None:
    _remembered[path] = (size, found)
    _remembered.move_to_end(path)
    while len(_remembered) > REMEMBERED_FILES:
        _remembered.popitem(last=False)
