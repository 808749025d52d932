"""The flight recorder beside a running robot, as `msbot master` and `msbot demo` offer it."""

from __future__ import annotations

import time
from collections.abc import Coroutine
from pathlib import Path

import click

from msbot.config import Library
from msbot.master import Master
from msbot.operations.dispatch import RunningOperations
from msbot.recording.recorder.ring import RingLimits
from msbot.recording.recorder.wish import RecordingWish, read_wish
from msbot_agent.space import Space
from msbot_xrce.errors import ConfigError


class WishType(click.ParamType[RecordingWish]):
    """`10min`, `500MB`, `lesson.mcap`, `off`."""

    name = "wish"

    def convert(
        self, value: str | RecordingWish, param: click.Parameter | None, ctx: click.Context | None
    ) -> RecordingWish:
        """What is to be recorded."""
        if isinstance(value, RecordingWish):
            return value
        try:
            return read_wish(value)
        except ConfigError as error:
            self.fail(str(error), param, ctx)


rec_option = click.option(
    "--rec", type=WishType(), metavar="10min|500MB|FILE|off", default="10min", show_default=True, envvar="MSBOT_REC",
    help="What the flight recorder keeps: the last minutes or megabytes, everything in an .mcap file too, or nothing.",
)  # fmt: skip


class RobotRecording:
    """Records one robot; must be made inside its event loop.

    Args:
        wish: what is recorded.
        folder: where the ring is.
        library: says what the message types mean.
    """

    def __init__(self, wish: RecordingWish, folder: Path, library: Library) -> None:
        self._wish = wish
        self._folder = folder
        if wish.file is not None and wish.file.exists():
            raise ConfigError(f"{wish.file}: the file is there already; give the recording another name")
        if wish.on:
            from msbot.recording.recorder.recorder import Recorder  # with `--rec off`, nothing of it is needed

            self._recorder: Recorder | None = Recorder(time.monotonic, time.time_ns, library)
        else:
            self._recorder = None

    def space(self, space: Space) -> Space:
        """The space for the robot."""
        return space if self._recorder is None else self._recorder.space(space)

    def beside(self, master: Master, operations: RunningOperations) -> list[Coroutine[object, object, None]]:
        """Begin to listen to the robot; what must run beside it."""
        if self._recorder is None:
            return []
        from msbot.recording.curves.measuring import keep_measuring
        from msbot.recording.recorder.recorder_process import RecorderProcess, run_recorder

        process = RecorderProcess(self._recorder, self._folder, RingLimits(self._wish.seconds, self._wish.octets))
        self._recorder.watch(master, operations)
        operations.recording.use(process)
        if self._wish.file is not None:
            process.record(self._wish.file.absolute())
        return [run_recorder(process), keep_measuring(master.agent, master.inventory.view, self._recorder.measured)]
