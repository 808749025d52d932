"""The service `recording` of `msbot agent`: the flight recorder, `--rec FILE`."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import click

from msbot_agent.cli.agent.agent_service import AgentContext, AgentService
from msbot_agent.cli.services import Beside
from msbot_agent.link import Link
from msbot_agent.space import Space
from msbot_xrce.errors import ConfigError

SUFFIX = ".mcap"


def check_recording(path: Path) -> None:
    """Make sure that a recording can be made there.

    Raises:
        ConfigError: the text says what would be right.
    """
    if path.suffix.lower() != SUFFIX:
        raise ConfigError(f"--rec {path}: a recording is a file that ends in {SUFFIX}: {path}{SUFFIX}")
    if path.exists():
        raise ConfigError(f"--rec {path}: the file is there already; give the recording another name")
    if not path.absolute().parent.is_dir():
        raise ConfigError(f"--rec {path}: there is no folder {path.absolute().parent}")
    try:
        import msbot.recording.recorder.recorder_process  # noqa: F401
    except ImportError as error:
        raise ConfigError(f"--rec needs the package {error.name}: `pip install 'msbot[master]'`") from error


class AgentRecording:
    """Records one agent; must be made inside its event loop.

    Args:
        path: where; see `check_recording`.
    """

    def __init__(self, path: Path) -> None:
        from msbot.config import load_library
        from msbot.recording.recorder.recorder import Recorder

        self._path = path.absolute()
        # The types that MsBOT knows have schemas; samples of others are recorded as octets.
        self._recorder = Recorder(time.monotonic, time.time_ns, load_library())

    def space(self, space: Space) -> Space:
        """The space for the agent."""
        return self._recorder.space(space)

    async def run(self, link: Link) -> None:
        """Record until cancelled; then the file is finished."""
        from msbot.recording.recorder.recorder_process import RecorderProcess, run_recorder
        from msbot.recording.recorder.ring import RingLimits
        from msbot.recording.recorder.wish import RING_OCTETS, RING_S

        process = RecorderProcess(self._recorder, None, RingLimits(RING_S, RING_OCTETS))
        self._recorder.watch_links([link])
        process.record(self._path)
        await run_recorder(process)


class RecordingService(AgentService[Path]):
    """`msbot agent ... --rec FILE`."""

    options = (
        click.option("--rec", metavar="FILE", type=click.Path(path_type=Path),
                     help="Record samples and CAN frames in this .mcap file (extra msbot[master])."),
    )  # fmt: skip

    def __init__(self) -> None:
        self._running: AgentRecording | None = None

    def check(self, given: Mapping[str, Any]) -> Path | None:
        """Where the recording goes."""
        path: Path | None = given["rec"]
        if path is not None:
            if given.get("master") is not None:
                raise ConfigError(
                    "--rec is for an agent on its own; a robot is recorded by its master: `msbot master --rec`"
                )
            check_recording(path)
        return path

    def space(self, wanted: Path, space: Space) -> Space:
        """The data space with the recorder before it."""
        self._running = AgentRecording(wanted)
        return self._running.space(space)

    def beside(self, wanted: Path, context: AgentContext) -> Iterable[Beside]:  # noqa: ARG002 - the recorder has it
        """The recorder."""
        assert self._running is not None
        (link,) = context.links
        return [self._running.run(link)]


RECORDING = RecordingService()
