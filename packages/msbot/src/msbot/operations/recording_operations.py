"""The flight recorder, as people start and stop it."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

from msbot.operations.operation import Outcome
from msbot.operations.part_names import describe
from msbot.operations.running_robot import RunningRobot
from msbot.part.join.part_log import LogLevel
from msbot.pnp import PartInfo, runs_in_words
from msbot_agent.text.sentence import Sentence, joined, said
from msbot_xrce.errors import ConfigError, RegistryError

_LEAST_ROOM = 1 << 20
"""With fewer octets on its disk, no recording is begun: it would end at once."""
MOST_NAMES = 30
"""So many topics are named in a sentence."""


class RecorderControl(Protocol):
    """What records this robot."""

    def record(self, path: Path, *, as_bag: bool) -> None:
        """Record in one more file from now on: everything, or as a bag what ROS 2 can read."""

    def end_record(self) -> str:
        """End that file; its path, empty if there was none."""

    async def wait_until_complete(self, file: str) -> Sequence[str] | None:
        """Wait until that file is complete: topics of which something is not in it; None: it could not be finished."""

    def as_json(self) -> Mapping[str, object]:
        """Where it records, and what is wrong with it."""


class Recording:
    """The operations of a robot's flight recorder."""

    def __init__(self) -> None:
        self._recorder: RecorderControl | None = None

    def attach(self, recorder: RecorderControl) -> None:
        """Say what records this robot."""
        self._recorder = recorder

    async def record(self, file: str, who: str, *, ros2: bool) -> Outcome:  # noqa: ARG002 - what all are given
        """Record in a file of its own, in addition to the ring; one that was recorded so far ends."""
        path = Path(file)
        await asyncio.to_thread(_check_new, path)
        recorder = self._the_recorder()
        earlier = recorder.end_record()
        recorder.record(path, as_bag=ros2)
        if ros2:
            begun = said("what ROS 2 can read is recorded in {file} from now on", file=file)
        else:
            begun = said("everything is recorded in {file} from now on", file=file)
        if not earlier:
            return Outcome(begun)
        ended = _in_words(earlier, await recorder.wait_until_complete(earlier))
        return Outcome(joined("; ", (ended, begun)))

    async def end_record(self, who: str) -> Outcome:  # noqa: ARG002 - as above
        """End that file."""
        recorder = self._the_recorder()
        file = recorder.end_record()
        if not file:
            raise ConfigError(said("nothing is recorded but the ring: `msbot rec save` keeps that"))
        return Outcome(_in_words(file, await recorder.wait_until_complete(file)))

    def recording(self) -> Outcome:
        """Where the robot is recorded; an empty answer: nowhere."""
        return Outcome(answer={} if self._recorder is None else dict(self._recorder.as_json()))

    def _the_recorder(self) -> RecorderControl:
        if self._recorder is None:
            raise ConfigError(said("this robot runs with `--rec off`: it has no recorder"))
        return self._recorder


def _check_new(path: Path) -> None:
    """Make sure that a recording can be made there.

    Raises:
        ConfigError: the text says what would be right.
    """
    file, folder = str(path), str(path.parent)
    if not path.is_absolute():
        raise ConfigError(said("{file}: the file is named with its whole path", file=file))
    try:
        is_folder, is_there = path.parent.is_dir(), path.exists()
    except PermissionError:  # a folder above it is closed
        raise ConfigError(_not_writable(file, folder)) from None
    if not is_folder:
        raise ConfigError(said("{file}: there is no folder {folder}", file=file, folder=folder))
    if is_there:
        raise ConfigError(said("{file} is there already: give the recording another name", file=file))
    if not os.access(folder, os.W_OK):
        raise ConfigError(_not_writable(file, folder))
    room = shutil.disk_usage(folder)
    if (
        room.total and room.free < _LEAST_ROOM
    ):  # of no size at all: no disk, where a recording says itself what is wrong
        raise ConfigError(said("{file}: the disk of {folder} is full; delete something", file=file, folder=folder))


def _not_writable(file: str, folder: str) -> Sentence:
    return said("{file}: the user of the master may not write into {folder}", file=file, folder=folder)


def _in_words(file: str, left_out: Sequence[str] | None) -> Sentence:
    if left_out is None:
        return said("{file} is not complete yet, or could not be written: see `msbot rec list`", file=file)
    if not left_out:
        return said("{file} is complete", file=file)
    named = ", ".join(left_out[:MOST_NAMES]) + (", ..." if len(left_out) > MOST_NAMES else "")
    return said("{file} is complete; left out, for they are no ROS 2 messages: {topics}", file=file, topics=named)


# What helps people to find parts: a part shows itself, says why its state is what it is, or is hidden.


STORED_S = 2.0
"""Longest time that a caller waits until everything noted so far is stored."""

_log = logging.getLogger(__name__)


class PartQueries:
    """Changes nothing that is stored."""

    def __init__(self, running: RunningRobot) -> None:
        self._running = running
        self._ignored: set[bytes] = set()

    def identify(self, part: str, who: str) -> Outcome:
        """Have a part show itself: blink, beep, whatever it can."""
        info = self._running.part(part, prefer=lambda one: one.state.is_registered)
        if not self._running.master.inventory_service.identify(info.client_key):
            raise ConfigError(
                said("{part} cannot be told to show itself: its program speaks the thesis' layout only", part=info.part)
            )
        _log.info("%s has %s show itself", who, describe(info))
        return Outcome(said("{part} is told to show itself", part=info.part))

    async def stored(self) -> Outcome:
        """Wait a moment until everything the robot has noted is stored, for callers that then read the database."""
        registry = self._running.registry
        if registry is None:
            return Outcome(answer={"trouble": "", "waiting": 0})
        storage = registry.storage
        with contextlib.suppress(RegistryError):  # what is wrong is in the answer
            await storage.in_time(storage.flush, STORED_S)
        health = storage.health
        return Outcome(answer={"trouble": health.trouble or "", "waiting": health.waiting})

    def versions(self) -> Outcome:
        """Where the parts in the slots run, and the versions that they say; no UID, for everybody may ask."""
        slots = {
            info.slot: {"home": info.home, "msbot": info.msbot, "hardware": info.hardware, "software": info.software}
            for info in self._running.inventory.view(self._running.now())
            if info.slot is not None and info.state.is_registered
        }
        return Outcome(answer={"slots": slots})

    def why(self, part: str) -> Outcome:
        """The state of a part and the rules that led to it, in sentences; none when no part is known by that word."""
        is_known = self._running.inventory.find(part, self._running.now())
        master = self._running.master
        # The journal has the errors that its program logged.
        troubles = [*master.troubles(part), *master.program_lines(part, LogLevel.WARNING)]
        runs = [words for info in is_known if (words := runs_in_words(info.home, info.msbot))]
        return Outcome(answer={"lines": master.why(part) if is_known else [], "runs": runs, "troubles": troubles})

    def ignore(self, part: str, who: str) -> Outcome:
        """Hide a part that is not let in from the list of arrivals, until the master ends."""
        info = self._running.part(part, prefer=lambda one: not one.state.is_registered)
        self._ignored.add(_identity(info))
        _log.info("%s ignores %s", who, describe(info))
        return Outcome(said("{part} is no longer shown among the arrivals", part=info.part))

    def is_ignored(self, info: PartInfo) -> bool:
        """Whether somebody asked not to be shown this part among the arrivals."""
        return _identity(info) in self._ignored


def _identity(info: PartInfo) -> bytes:
    return info.uid or info.client_key.to_bytes(4, "big")
