"""Starts the recorder's process, feeds it, and starts it again should it end."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import queue
import select
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, field
from functools import partial
from pathlib import Path
from typing import Any, Final

from msbot.recording.recorder.batch import OWN_TOPICS
from msbot.recording.recorder.recorder import Recorder
from msbot.recording.recorder.recording_file import RingLimits
from msbot_agent.process.timer_grid import until_step
from msbot_xrce.lazy import dataclass

DRAIN_S: Final = 0.5
"""How often what was heard is handed over: so much is lost when the robot is killed."""
BUSY_DRAIN_S: Final = 0.1
"""How often that is while so much is heard that a pause of `DRAIN_S` would fill the pipe."""
BUSY_OCTETS: Final = 32 << 10
"""Octets of one hand-over from which on it is so."""
MOST_WAITING: Final = 8 << 20
"""Octets that may wait for the recorder's process."""
AGAIN_S: Final = 3.0
"""Pause before it is started again."""
END_S: Final = 10.0
"""Longest wait for it to finish its files at the end."""
FINISHED_S: Final = 4.0
"""Longest wait for it to finish a file while the robot runs: less than people's programs wait for an answer."""
_AT_ONCE: Final = os.name == "posix"
"""Whether a pipe can be written to without a wait."""

logger = logging.getLogger(__name__)


@dataclass(slots=True)
class RecorderStatus:
    """How the recorder is doing."""

    folder: str = ""
    """Where the ring is; empty: there is none."""
    file: str = ""
    """The file that is recorded in addition; empty: none."""
    ros2: bool = False
    """Whether that file is a bag of ROS 2."""
    not_ros2: list[str] = field(default_factory=list)
    """Topics of which something is not in that bag, because it is no ROS 2 message, or a value does not fit."""
    left_out: int = 0
    """Octets of records that had to be left out, because the recorder's process could not keep up."""
    restarts: int = 0
    troubles: dict[str, str] = field(default_factory=dict)
    """File -> what is wrong with it."""


@dataclass(slots=True)
class _ExtraFile:
    """A file that is recorded in addition, until the recorder's process has finished it or given it up."""

    left_out: list[str] = field(default_factory=list)
    end: asyncio.Event = field(default_factory=asyncio.Event)
    is_whole: bool = False


class RecorderProcess:
    """Hands what a `Recorder` hears to a process of its own; must be made inside the robot's event loop."""

    def __init__(self, recorder: Recorder, folder: Path | None, limits: RingLimits) -> None:
        self.recorder = recorder
        self.status = RecorderStatus("" if folder is None else str(folder))
        self._command = [
            sys.executable,
            "-P",
            "-m",
            "msbot.recording.recorder",
            self.status.folder,
            str(limits.seconds),
            str(limits.octets),
        ]
        self._loop = asyncio.get_running_loop()
        self._files: dict[str, _ExtraFile] = {}
        self._process: subprocess.Popen[bytes] | None = None
        self._waiting: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._waiting_octets = 0
        self._is_feeding = False
        """Whether the thread writes; whoever reads or changes it, or the octets that wait, holds the lock."""
        self._lock = threading.Lock()
        self._end = threading.Event()
        self._feeder: threading.Thread | None = None

    def start(self) -> None:
        """Start the process and the thread that feeds it."""
        self._open()
        self._feeder = threading.Thread(target=self._feed, name="msbot-recorder-feed", daemon=True)
        self._feeder.start()

    def hand_over(self) -> int:
        """Give the process what was heard since the last time; called in the robot's event loop.

        Returns:
            how many octets that were.
        """
        octets = self.recorder.drain()
        heard = len(octets)
        if octets:
            octets = self._given_at_once(octets)
        if not octets:
            return heard
        with self._lock:
            is_full = self._waiting_octets + len(octets) > MOST_WAITING
            if not is_full:
                self._waiting_octets += len(octets)
        if is_full:
            self.status.left_out += len(octets)
            self._tell_left_out()
        else:
            self._waiting.put(octets)
        return heard

    def _given_at_once(self, octets: bytes) -> bytes:
        """Write as much as the process takes without a wait; what is left is for the thread, which also finds out when
        the process has ended. A robot at rest says little, and the thread sleeps on."""
        process = self._process
        with self._lock:
            if process is None or process.stdin is None or self._waiting_octets or self._is_feeding or not _AT_ONCE:
                return octets
        try:
            return octets[process.stdin.write(octets) or 0 :]
        except OSError:
            return octets

    def close(self) -> None:
        """Wait until the files are finished, for so long; a busy computer may need longer, and its user is told."""
        self._end.set()
        self._waiting.put(None)
        if self._feeder is not None:
            self._feeder.join(END_S)
        if self._process is not None and self._process.poll() is None:
            try:
                self._process.wait(END_S)
            except subprocess.TimeoutExpired:
                files = ", ".join(filter(None, (self.status.folder, *self._files)))
                logger.warning("recording: this computer is busy: %s will be complete in a moment", files)

    def record(self, path: Path, *, as_bag: bool = False) -> None:
        """Record in one more file from now on.

        Args:
            path: the file.
            as_bag: only what ROS 2 can read, as a bag.
        """
        file = _ExtraFile()
        self.status.file, self.status.ros2, self.status.not_ros2 = str(path), as_bag, file.left_out
        self.status.troubles.pop(self.status.file, None)
        self._files[self.status.file] = file
        self.recorder.start(self.status.file, as_bag=as_bag)

    def end_record(self) -> str:
        """End that file; its path, empty if there was none."""
        file = self._no_file()
        if file:
            self.recorder.stop()
            self.hand_over()
        return file

    async def wait_until_complete(self, file: str) -> Sequence[str] | None:
        """Wait until a file that `end_record` named is complete.

        Returns:
            the topics of which something is not in it, because it is a bag; None: the recorder could not finish it, or
            has not in a long time.
        """
        known = self._files.get(file)
        if known is None:
            return None
        try:
            async with asyncio.timeout(FINISHED_S):
                await known.end.wait()
        except TimeoutError:
            self._files.pop(file, None)
        return sorted(known.left_out) if known.is_whole else None

    def _no_file(self) -> str:
        file = self.status.file
        self.status.file, self.status.ros2, self.status.not_ros2 = "", False, []
        return file

    def as_json(self) -> Mapping[str, object]:
        """Where it records, and what is wrong with it."""
        return asdict(self.status)

    def _open(self) -> None:
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
        self._process = subprocess.Popen(
            self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment, bufsize=0
        )
        if _AT_ONCE:
            assert self._process.stdin is not None
            os.set_blocking(self._process.stdin.fileno(), False)
        threading.Thread(target=self._listen, args=(self._process,), name="msbot-recorder-listen", daemon=True).start()

    def _feed(self) -> None:
        while (octets := self._waiting.get()) is not None:
            with self._lock:
                self._waiting_octets -= len(octets)
                self._is_feeding = True
            self._write(octets)
            with self._lock:
                self._is_feeding = False
        assert self._process is not None
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):  # it has ended by itself, which was told
            self._process.stdin.close()

    def _write(self, octets: bytes) -> None:
        assert self._process is not None
        assert self._process.stdin is not None
        view = memoryview(octets)
        try:
            while view:
                written = self._process.stdin.write(view)
                if written is None:
                    _wait_for_room(self._process.stdin.fileno())
                view = view[written or 0 :]
        except OSError:
            self._again()

    def _again(self) -> None:
        """The process has ended: start another one, which is told everything from the beginning."""
        self.status.restarts += 1
        logger.warning("the recorder has ended; another one is started")
        if self._end.wait(AGAIN_S):
            return
        while not self._waiting.empty():
            if self._waiting.get() is None:  # at the end
                self._waiting.put(None)
                break
        with self._lock:
            self._waiting_octets = 0
        self._open()
        self._from_loop(self._say_again)

    def _say_again(self) -> None:
        self.recorder.say_again()
        self.recorder.note({"why": "the recorder had ended, and was started again"})
        if self.status.file:
            path = Path(self.status.file)
            self._files.pop(self.status.file, None)
            self.record(path.with_stem(f"{path.stem}-{self.status.restarts + 1}"), as_bag=self.status.ros2)

    def _tell_left_out(self) -> None:
        why = "more was said than could be written"
        self.recorder.note({"left_out_octets": self.status.left_out, "why": why})

    def _listen(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        with process.stdout as lines:
            for line in lines:
                self._from_loop(partial(self._heard, json.loads(line)))

    def _heard(self, said: Mapping[str, Any]) -> None:
        name = said["file"]
        file = self._files.get(name)
        match said:
            case {"left_out": topics} if file is not None:
                file.left_out.extend(topics)
                if foreign := [topic for topic in topics if not topic.startswith(OWN_TOPICS)]:
                    logger.warning("recording: %s leaves out what is no ROS 2 message: %s", name, ", ".join(foreign))
            case {"has_ended": True} if file is not None:
                file.is_whole = True
                file.end.set()
                del self._files[name]
            case {"trouble": ""}:
                self.status.troubles.pop(name, None)
            case {"trouble": trouble}:
                self.status.troubles[name] = trouble
                logger.warning("recording: %s %s", name, trouble)
                if name == self.status.file:
                    self._no_file()
                if file is not None:
                    file.end.set()
                    del self._files[name]

    def _from_loop(self, call: Callable[[], None]) -> None:
        with contextlib.suppress(RuntimeError):  # the robot has ended in the meantime
            self._loop.call_soon_threadsafe(call)


def _wait_for_room(descriptor: int) -> None:
    waiting = select.poll()
    waiting.register(descriptor, select.POLLOUT)
    waiting.poll()


async def run_recorder(process: RecorderProcess) -> None:
    """Record until cancelled; then the files are finished."""
    starting = asyncio.get_running_loop().run_in_executor(None, process.start)
    try:
        await asyncio.shield(starting)
        loop, heard = asyncio.get_running_loop(), 0
        while True:
            await asyncio.sleep(until_step(loop.time(), DRAIN_S if heard < BUSY_OCTETS else BUSY_DRAIN_S))
            heard = process.hand_over()
    finally:
        await starting  # what was heard until then is written all the same
        process.hand_over()
        await asyncio.to_thread(process.close)
