"""The service `fed` of `msbot agent`: its clients are parts of a robot whose master runs elsewhere, `--master`."""

from __future__ import annotations

import math
import platform
import time
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import click

from msbot.recording.recorder.batch import bag_wish
from msbot_agent.agent import Agent, AgentSettings
from msbot_agent.cli.agent.agent_service import AgentContext, AgentPlan, AgentService
from msbot_agent.cli.command_services import Beside
from msbot_agent.link import Link, open_link
from msbot_agent.space import MEMORY, Space, SpaceAddress
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass


@dataclass(frozen=True, slots=True)
class RemoteMaster:
    """A master that feeds this agent's gate."""

    address: str
    name: str
    """What it calls this agent."""


def remote_master_option(address: str | None, name: str | None, space: SpaceAddress) -> RemoteMaster | None:
    """What `--master` and `--name` say.

    Raises:
        ConfigError: they make no sense, or not with `--space`.
    """
    if address is None:
        if name is not None:
            raise ConfigError("--name is what a master calls this agent: say with --master ADDRESS where that is")
        return None
    if space.kind != MEMORY:
        raise ConfigError(
            "with --master the topics go to the robot's master: leave --space out here, and give it to `msbot master`"
        )
    open_link(address)  # report mistakes before anything runs
    return RemoteMaster(address, name or platform.node() or "agent")


def remote_master_settings(settings: AgentSettings) -> AgentSettings:
    """The same for an agent of a robot: a client that is silent is removed, as at a master."""
    if settings.dead_after_s < math.inf:
        return settings
    return replace(settings, dead_after_s=AgentSettings().dead_after_s)


class RemoteMasterService(AgentService[RemoteMaster]):
    """`msbot agent ... --master ADDRESS`."""

    options = (
        click.option(
            "--master",
            metavar="ADDRESS",
            help="Let the clients join the robot whose master is at ADDRESS, "
            "for example udp:192.168.1.20:8888, which decides who is let in.",
        ),
        click.option(
            "--name",
            metavar="NAME",
            help="With --master: the name by which the master reports this agent; default: the computer's name.",
        ),
    )

    def check(self, given: Mapping[str, Any]) -> RemoteMaster | None:
        """The master that feeds it."""
        return remote_master_option(given["master"], given["name"], given["space"])

    def agent(self, wanted: RemoteMaster, plan: AgentPlan) -> tuple[Agent, Beside]:
        """An agent whose gate that master feeds."""
        from msbot.master.remote_agent import RemoteAgent

        fed = RemoteAgent(
            plan.open_for,
            open_link(wanted.address),
            name=wanted.name,
            say=plan.say,
            space=plan.space,
            settings=remote_master_settings(plan.settings),
            references=plan.references,
            on_signal=plan.on_signal,
        )
        plan.say(f"agent {wanted.name} looks for the robot's master on {wanted.address}; Ctrl-C ends it")
        return fed.agent, fed.run()


FED = RemoteMasterService()


# The service `recording` of `msbot agent`: the flight recorder, `--rec FILE`.


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


class RecordedFile(NamedTuple):
    """What `--rec` asks for."""

    path: Path
    is_bag: bool
    """What ROS 2 can read, as a bag; else everything."""


class AgentRecording:
    """Records one agent; must be made inside its event loop.

    Args:
        wanted: where; see `check_recording`.
    """

    def __init__(self, wanted: RecordedFile) -> None:
        from msbot.config import load_library
        from msbot.recording.recorder.recorder import Recorder

        self._path, self._is_bag = wanted.path.absolute(), wanted.is_bag
        # The types that MsBOT knows have schemas; samples of others are recorded as octets.
        self._recorder = Recorder(time.monotonic, time.time_ns, load_library())

    def space(self, space: Space) -> Space:
        """The space for the agent."""
        return self._recorder.space(space)

    async def run(self, link: Link) -> None:
        """Record until cancelled; then the file is finished."""
        from msbot.recording.recorder.batch import RING_OCTETS, RING_S
        from msbot.recording.recorder.recorder_process import RecorderProcess, run_recorder
        from msbot.recording.recorder.recording_file import RingLimits

        process = RecorderProcess(self._recorder, None, RingLimits(RING_S, RING_OCTETS))
        self._recorder.watch_links([link])
        process.record(self._path, as_bag=self._is_bag)
        await run_recorder(process)


class RecordingService(AgentService[RecordedFile]):
    """`msbot agent ... --rec FILE`."""

    options = (
        click.option(
            "--rec",
            metavar="FILE",
            type=click.Path(path_type=Path),
            help="Record samples and CAN frames in this .mcap file (extra msbot[master]); `FILE,ros2`: what ROS 2 can "
            "read, as a bag.",
        ),
    )

    def __init__(self) -> None:
        self._running: AgentRecording | None = None

    def check(self, given: Mapping[str, Any]) -> RecordedFile | None:
        """Where the recording goes."""
        path: Path | None = given["rec"]
        if path is None:
            return None
        if given.get("master") is not None:
            raise ConfigError(
                "--rec is for an agent on its own; a robot is recorded by its master: `msbot master --rec`"
            )
        name, is_bag = bag_wish(str(path))
        check_recording(Path(name))
        return RecordedFile(Path(name), is_bag)

    def space(self, wanted: RecordedFile, space: Space) -> Space:
        """The data space with the recorder before it."""
        self._running = AgentRecording(wanted)
        return self._running.space(space)

    def coroutines(self, wanted: RecordedFile, context: AgentContext) -> Iterable[Beside]:  # noqa: ARG002 - the recorder has it
        """The recorder."""
        assert self._running is not None
        (link,) = context.links
        return [self._running.run(link)]


RECORDING = RecordingService()
