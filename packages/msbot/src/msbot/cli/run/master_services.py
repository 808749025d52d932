"""What a service gets to know of the master that it runs beside."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Coroutine, Iterable, Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from msbot.cli.robot_options import metrics_option
from msbot.config import Library
from msbot.master import Master
from msbot.pnp.part_events import PartEvent
from msbot.recording.recorder.batch import RecordingRequest, read_wish
from msbot_agent.agent import Agent
from msbot_agent.cli.agent.agent_service import AgentContext
from msbot_agent.cli.command_services import Beside, CommandService, ServedCommand
from msbot_agent.cli.logs import EVENTS
from msbot_agent.link import Link
from msbot_agent.log import ALWAYS, FIELDS
from msbot_agent.space import Space, SpaceAddress
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

if TYPE_CHECKING:
    # `msbot agent --metrics` needs this file, and neither a database nor a recorder.
    from msbot.metrics import PageFigures
    from msbot.operations.dispatch import InProcessOperations, PerformedOperation
    from msbot.registry import Registry, RobotRecord


def _no_page() -> str:
    return ""


@dataclass(slots=True)
class MasterContext:
    """The running robot."""

    master: Master
    operations: InProcessOperations
    library: Library
    registry: Registry
    robot: RobotRecord
    """The robot in the database."""
    db: str
    """The database as it was named."""
    links: Sequence[Link]
    space: SpaceAddress
    say: Callable[[str], None]
    """Says a line to the person at the terminal."""
    offers: dict[str, object] = field(default_factory=dict)
    """What services have for those that come after them, by the name of the service."""
    page_address: Callable[[], str] = _no_page
    """Where the robot's page is, for other programs; empty: it has none."""
    page_figures: Callable[[], PageFigures] | None = None
    """How the page is; None: there is none."""

    @property
    def agent(self) -> Agent:
        """The master's agent."""
        return self.master.agent

    @property
    def ready(self) -> asyncio.Event:
        """Set when the robot is up."""
        return self.master.ready


class MasterCommand(ServedCommand):
    """A command that runs a master."""

    group = "services"


# What happens to parts, and who says STOP, as lines of a log in JSON.


_events = logging.getLogger(EVENTS)


def log_event(event: PartEvent) -> None:
    """A change of a part as a line of the log, with its values."""
    fields = {
        "part": event.part,
        "slot": event.slot or "",
        "from": event.from_state.value if event.from_state else "",
        "to": event.to_state.value,
        "reason": str(event.reason),
        "uid": event.uid.hex(),
    }
    # What happens to parts in slots is bounded by their number; strangers may come without end.
    _events.info("%s", event.sentences()[0], extra={FIELDS: fields, ALWAYS: bool(event.slot)})


STOP_AND_GO = ("stop", "go")


def log_stop(deed: PerformedOperation) -> None:
    """Who said STOP or GO, from where and why, as a line of the log; other operations are none."""
    if deed.operation in STOP_AND_GO:
        _events.info("%s", deed.words, extra={FIELDS: {"operation": deed.operation, "who": deed.who}, ALWAYS: True})


# The figures beside a running robot or agent, as `--metrics PORT` asks for them; a service of `msbot agent`.


def metrics_beside(
    port: int | None,
    agent: Agent,
    say: Callable[[str], None],
    *,
    master: Master | None = None,
    registry: Registry | None = None,
    page: Callable[[], PageFigures] | None = None,
) -> list[Coroutine[object, object, None]]:
    """What runs beside the robot to serve its figures; nothing when nobody has asked for them.

    Raises:
        ConfigError: the port cannot be had, or a package is missing.
    """
    if port is None:
        return []
    from msbot.metrics import DatabaseFigures, MetricsCollector, MetricsSampler, MetricsServer
    from msbot.metrics.figures import meter_of

    def database() -> DatabaseFigures:
        assert registry is not None
        health = registry.storage.health
        return DatabaseFigures(health.waiting, health.lost, health.is_well)

    noting = MetricsSampler(agent, master)
    links = agent.links if master is None else master.links
    # The page measures the bus already, if there is one.
    meter = meter_of(links, asyncio.get_running_loop().time) if page is None else None
    collecting = MetricsCollector(
        agent,
        master=master,
        database=None if registry is None else database,
        page=page,
        noting=noting,
        bus=meter,
    )
    server = MetricsServer(collecting, noting, port)
    say(f"Figures for Prometheus are at {server.address}")
    return [server.run()]


class AgentMetrics(CommandService[int, AgentContext]):
    """`msbot agent ... --metrics PORT`."""

    options = (metrics_option,)

    def check(self, given: Mapping[str, Any]) -> int | None:
        """The port; None: no figures are wanted."""
        port: int | None = given["metrics_port"]
        return port

    def coroutines(self, wanted: int, context: AgentContext) -> Iterable[Beside]:
        """What serves the figures."""
        return metrics_beside(wanted, context.agent, context.say)


AGENT_METRICS = AgentMetrics()


# The flight recorder beside a running robot, as `msbot master` and `msbot demo` offer it.


class RecordingLimitType(click.ParamType[RecordingRequest]):
    """`10min`, `500MB`, `lesson.mcap`, `off`."""

    name = "wish"

    def convert(
        self, value: str | RecordingRequest, param: click.Parameter | None, ctx: click.Context | None
    ) -> RecordingRequest:
        """What is to be recorded."""
        if isinstance(value, RecordingRequest):
            return value
        try:
            return read_wish(value)
        except ConfigError as error:
            self.fail(str(error), param, ctx)


rec_option = click.option(
    "--rec",
    type=RecordingLimitType(),
    metavar="10min|500MB|FILE|off",
    default="10min",
    show_default=True,
    envvar="MSBOT_REC",
    help="What the flight recorder keeps: the last minutes or megabytes, everything in an .mcap file too (`FILE,ros2`: "
    "what ROS 2 can read, as a bag), or nothing.",
)


class RobotRecording:
    """Records one robot; must be made inside its event loop.

    Args:
        wish: what is recorded.
        folder: where the ring is.
        library: says what the message types mean.
    """

    def __init__(self, wish: RecordingRequest, folder: Path, library: Library) -> None:
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

    def coroutines(self, master: Master, operations: InProcessOperations) -> list[Coroutine[object, object, None]]:
        """Begin to listen to the robot; what must run beside it."""
        if self._recorder is None:
            return []
        from msbot.recording.recorder.measurements import keep_measuring
        from msbot.recording.recorder.recorder_process import RecorderProcess, run_recorder
        from msbot.recording.recorder.recording_file import RingLimits

        process = RecorderProcess(self._recorder, self._folder, RingLimits(self._wish.seconds, self._wish.octets))
        self._recorder.watch(master, operations)
        operations.recording.attach(process)
        if self._wish.file is not None:
            process.record(self._wish.file.absolute(), as_bag=self._wish.is_bag)
        return [run_recorder(process), keep_measuring(master.agent, master.inventory.view, self._recorder.measured)]
