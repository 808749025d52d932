"""`msbot demo`: the sample robot, live in the terminal, as lines, or as one JSON object."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import sys
import time
from collections.abc import Callable, Coroutine, Iterable, Iterator
from functools import partial
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING

import click

from msbot.cli.bus.frame_log import FrameLog
from msbot.cli.change.robot_access import master_details
from msbot.cli.robot_options import metrics_option, user_name
from msbot.cli.run.bridges_beside import bridges_beside, check_bridges, simulated_devices
from msbot.cli.run.master_services import RobotRecording, log_event, metrics_beside, rec_option
from msbot.cli.run.world_options import WorldOptions, world_options
from msbot.config import SAMPLES, Blueprint, Library, open_blueprint
from msbot.master import StopSocket, robot_space
from msbot.operations.dispatch import InProcessOperations, perform
from msbot.recording.recorder.batch import RecordingRequest
from msbot.registry import Registry, RobotRecord, RobotStore, StoredNodeIds, open_registry
from msbot_agent.agent import MASTER, StatusServer
from msbot_agent.cli.logs import LogOptions, log_options
from msbot_agent.cli.options import FiniteRange, WholeRange, space_option
from msbot_agent.link.can.sim import SimBusServer, check_free
from msbot_agent.process.end_signals import on_end_signal, run_to_end, ungrouped
from msbot_agent.process.nonblocking_output import nonblocking_output
from msbot_agent.process.timer_grid import TimerGridLoop
from msbot_agent.space import SharedSpace, SpaceAddress
from msbot_agent.startup.bytecode_cache import without_garbage_collection
from msbot_agent.startup.extensions import extensions
from msbot_school.cli.teaching_service import lessons_option
from msbot_school.demo import DemoLinkKind, DemoRobot
from msbot_school.demo.gallery import DemoChoice
from msbot_school.faults.fault_lab import FaultLab
from msbot_school.lessons.lesson import Lesson
from msbot_school.lessons.lesson_controller import LessonController
from msbot_school.missions.mission_lab import MissionLab
from msbot_web.cli.demo.demo_world import (
    PILOT,
    DemoWorld,
    blueprint_for,
    chosen_lesson,
    make_lesson_controller,
    start_lesson,
)
from msbot_web.cli.demo.handover import DemoCommand, Handover, demo_folder, own_arguments, read_handover, start_anew
from msbot_web.cli.demo.output import Notes, as_json, event_words, status_words
from msbot_web.cli.demo.script import KeyPresses, ScriptRun, ScriptStep, ScriptType
from msbot_web.cli.page import PageOptions, page_options, page_wishes, serve_page
from msbot_xrce.errors import ConfigError, MsbotError
from msbot_xrce.lazy import dataclass

if TYPE_CHECKING:
    from rich.console import RenderableType

    from msbot.sim.arena.running_arena import RunningArena
    from msbot_web.assembly import RobotPages
    from msbot_web.gallery import ChangeWish

REFRESH_S = 0.2
STATUS_S = 5.0
"""How often a demo that prints lines says how all parts are; what changes it says at once."""
ANSWERED_S = 0.3
"""How long the page has to answer whoever has chosen another robot, before this one ends."""


@dataclass(frozen=True, slots=True)
class _Options:
    wire: DemoLinkKind
    bitrate: int
    data_bitrate: int
    compression: bool
    seconds: float | None
    script: list[ScriptStep]
    json: bool
    log: Path | None
    bus: str | None
    seed: int | None
    sample: str
    spare: bool
    lesson: Lesson | None
    lessons: tuple[Path, ...]
    page: PageOptions
    space: SpaceAddress
    rec: RecordingRequest
    metrics_port: int | None
    log_wishes: LogOptions
    world: WorldOptions
    before: Handover | None
    """What the demo before in this place has left."""

    @property
    def choice(self) -> DemoChoice:
        """What it runs, as the gallery has it."""
        return DemoChoice(self.sample if self.lesson is None else self.lesson.robot, self.world.world or "")


@click.command("demo", cls=DemoCommand)
@click.option(
    "--link",
    "wire",
    type=click.Choice([wire.value for wire in DemoLinkKind]),
    default="can",
    show_default=True,
    help="The wire: simulated classic CAN, simulated CAN FD, or UDP on this machine.",
)
@click.option(
    "--bitrate",
    type=WholeRange(10_000, 1_000_000),
    default=500_000,
    show_default=True,
    help="Bit rate of the CAN bus, bit/s.",
)
@click.option(
    "--data-bitrate",
    type=WholeRange(10_000, 8_000_000),
    default=2_000_000,
    show_default=True,
    help="Bit rate of the data phase of CAN FD, bit/s.",
)
@click.option("--no-compression", is_flag=True, help="Send DDS-XRCE headers on CAN as they are.")
@click.option("--seconds", type=FiniteRange(min=0.1), help="End after this time.")
@click.option(
    "--script",
    type=ScriptType(),
    default="",
    help='Unplug and plug in parts at given times: "3:unplug AA;12:plug AA;15:undo"; a step waits up to 10 s '
    "for its part.",
)
@click.option("--json", "as_json_object", is_flag=True, help="Print one JSON object at the end and nothing else.")
@click.option(
    "--log",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write every frame on the CAN bus to this file, as candump does.",
)
@click.option("--bus", metavar="NAME", help="Let other programs join the CAN bus by this name (sim:NAME).")
@click.option("--seed", type=WholeRange(), help="Seed of all random values.")
@click.option(
    "--db", type=click.Path(path_type=Path), help="Keep the robot's database in this file; without it, nothing is kept."
)
@click.option(
    "--robot",
    "sample",
    type=click.Choice([*SAMPLES, *extensions().names("samples")]),
    help="The sample robot: a rover of ten parts, the thesis' ring of three, a buggy that drives, or one of an "
    "extension; default: rover, with --world buggy.",
)
@world_options
@click.option("--go-on", type=click.Path(path_type=Path, file_okay=False), hidden=True)
@click.option("--spare", is_flag=True, help="Add a spare, DD, which takes over when BB is lost.")
@click.option("--lesson", metavar="NAME", help="Run the robot of this lesson (`msbot lesson list`) and begin it.")
@lessons_option
@space_option
@rec_option
@metrics_option
@log_options
@page_options
def command(
    *,
    wire: str,
    bitrate: int,
    data_bitrate: int,
    no_compression: bool,
    seconds: float | None,
    script: list[ScriptStep],
    as_json_object: bool,
    log: Path | None,
    bus: str | None,
    seed: int | None,
    db: Path | None,
    sample: str | None,
    world: str | None,
    place: str | None,
    share: str | None,
    world_password: str | None,
    go_on: Path | None,
    spare: bool,
    lesson: str | None,
    lessons: tuple[Path, ...],
    space: SpaceAddress,
    rec: RecordingRequest,
    metrics_port: int | None,
    log_wishes: LogOptions,
    port: int | None,
    host: str,
    no_page: bool,
    certificate: Path | None,
    certificate_key: Path | None,
    page_names: tuple[str, ...],
    trusted_proxies: tuple[str, ...],
) -> None:
    """Run a robot on this machine, everything simulated: a rover of ten parts, or the thesis' ring of three.

    The page's address is printed. In a terminal, the key beside a part unplugs it and plugs it in again; q ends the
    robot. With --json only the object is printed, and there is no page unless --port is given.
    """
    before = None if go_on is None else read_handover(go_on)
    if before is not None:
        lesson, sample, place, script = before.lesson or None, before.robot, None, []
        world, share = before.world or None, share if before.world else None
        world_password, port, seconds = world_password if share else None, before.port, before.left_s
    chosen = chosen_lesson(lesson, lessons)
    options = _Options(
        DemoLinkKind(wire),
        bitrate,
        data_bitrate,
        not no_compression,
        seconds,
        script,
        as_json_object,
        log,
        bus,
        seed,
        sample or ("rover" if world is None else "buggy"),
        spare,
        chosen,
        lessons,
        page_wishes(
            port=port,
            host=host,
            no_page=no_page or (as_json_object and port is None),
            certificate=certificate,
            certificate_key=certificate_key,
            page_names=page_names,
            trusted_proxies=trusted_proxies,
        ),
        space,
        rec,
        metrics_port,
        log_wishes,
        WorldOptions(world or (chosen.world or None if chosen else None), place, share, world_password),
        before,
    )
    options.world.check()
    log_wishes.set_up(logging.WARNING)
    if log is not None and options.wire is DemoLinkKind.UDP:
        raise click.UsageError("--log writes the frames of a CAN bus: leave --link udp out")
    if bus is not None and options.wire is DemoLinkKind.UDP:
        raise click.UsageError("--bus is for a CAN bus: leave --link udp out")
    if bus is not None:
        check_free(bus)
    if as_json_object and seconds is None:
        raise click.UsageError("--json prints at the end: say when with --seconds N")
    if sys.stdout.isatty() and not options.page.off and not as_json_object:
        click.echo("Starting the robot and its page ...")
    with demo_folder(go_on) as folder, contextlib.suppress(KeyboardInterrupt):
        blueprint, library = open_blueprint(blueprint_for(options.sample, options.lesson, folder))
        check_bridges(blueprint)
        address = str(db or folder / "robot.db")
        nexts: list[Handover] = []
        with open_registry(address) as registry:  # may be slow, so no event loop waits for it
            robot = registry.robots.apply_blueprint(blueprint, library)
            store, node_ids = registry.runs.begin(robot), registry.runs.node_ids(robot, "demo")
            with nonblocking_output():
                run_to_end(
                    _main(options, blueprint, library, (registry, store, node_ids, address), folder, nexts=nexts),
                    TimerGridLoop,
                )
        if nexts:
            nexts[0].write(folder)
            start_anew(own_arguments(), folder)


async def _main(
    options: _Options,
    blueprint: Blueprint,
    library: Library,
    database: tuple[Registry, RobotStore, StoredNodeIds, str],
    folder: Path,
    *,
    nexts: list[Handover],
) -> None:
    registry, store, node_ids, address = database
    with robot_space(options.space, blueprint, library) as space:
        recording = RobotRecording(options.rec, folder / "rec", library)
        notes = Notes()
        world = DemoWorld(options.world, options.seed, notes.add)
        devices = simulated_devices(blueprint)
        robot = DemoRobot(
            blueprint,
            store,
            node_ids=node_ids,
            wire=options.wire,
            bitrate=options.bitrate,
            data_bitrate=options.data_bitrate,
            compression=options.compression,
            bus_name=options.bus or "",
            random=None if options.seed is None else Random(options.seed),
            library=library,
            space=recording.space(space),
            spares=_spares(blueprint) if options.spare else None,
            unplugged=[slot.name for slot in blueprint.slots if slot.part_number == PILOT],
            bridged=[slot.name for slot in blueprint.slots if _is_bridged(slot.part_number, library)],
            devices=devices,
            door=world.door,
        )
        _check_script(options.script, robot)
        if options.before is not None and options.before.stopped:
            robot.master.say_stop(options.before.stop_by, options.before.stop_reason)
        operations = InProcessOperations(robot.master, registry, store.robot, library=library)

        async def undo() -> str:
            return (await operations.do("undo", who="the script")).words

        script = ScriptRun(options.script, robot, undo, notes.add)
        with _logging(robot, options.log):
            beside: list[Coroutine[object, object, None]] = world.coroutines(operations)
            beside += bridges_beside(blueprint, robot.master, notes.add, devices)
            desk = make_lesson_controller(operations, options.lessons, robot, options.world.world or "")
            room: RobotPages | None = None

            def change(wish: ChangeWish) -> None:
                assert room is not None
                nexts.append(_handover(wish, robot, room, options))
                asyncio.get_running_loop().call_later(ANSWERED_S, robot.finish)

            def page_address() -> str:
                return "" if room is None else room.server.own_address

            if not options.page.off:
                with without_garbage_collection():
                    room = _make_page(
                        robot,
                        operations,
                        library,
                        (registry, store.robot, address),
                        options,
                        arena=world.living,
                        desk=desk,
                        change=change,
                    )
                beside.append(serve_page(room, None, options.page, notes.add))
            beside.append(
                _answering(robot, operations, address, page_address, lambda: registry.storage.health.trouble).run()
            )
            beside += metrics_beside(
                options.metrics_port,
                robot.master.agent,
                notes.add,
                master=robot.master,
                registry=registry,
                page=None if room is None else room.figures,
            )
            if options.log_wishes.is_json:
                robot.master.inventory.on_event(log_event)
            stop = StopSocket(robot.master, lambda: _details(robot, operations, address, page_address()))
            beside.append(stop.run())
            beside.extend(recording.coroutines(robot.master, operations))
            faults = FaultLab(operations, parts=robot, bus=robot.bus_driver)
            beside += [faults.run(), MissionLab(operations, faults).run()]
            beside += [desk.run(), _begin(desk, robot, options, notes)]
            if isinstance(space, SharedSpace):
                from msbot.ros.robot_in_ros import RobotInRos

                beside.append(RobotInRos(robot.master, operations, space).run())
            if options.bus is None or robot.bus_driver is None:
                await _run_beside(_run(robot, options, notes, script), beside)
            else:
                server = SimBusServer(robot.bus_driver, options.bus)
                await _run_served(server, partial(_run, robot, options, notes, script), beside)


async def _begin(desk: LessonController, robot: DemoRobot, options: _Options, notes: Notes) -> None:
    """Begin the lesson that was wished for, if any."""
    before = options.before
    try:
        await start_lesson(desk, options.lesson, robot, notes.add, user_name() if before is None else before.who)
    except MsbotError as error:
        if before is None:
            raise
        notes.add(f"The lesson has not begun: {error}")  # who chose it on the page sees the robot, and can try again


def _is_bridged(number: str, library: Library) -> bool:
    """Whether the demo makes no part there, because a device behind a bridge is one."""
    part_type = library.get(number)
    return part_type is not None and bool(part_type.origin)


def _spares(blueprint: Blueprint) -> dict[str, str]:
    """DD for the slot BB; in another sample one for the first slot."""
    of = "BB" if blueprint.slot("BB") else blueprint.slots[0].name
    return {"DD" if blueprint.slot("DD") is None else "spare": of}


def _details(
    robot: DemoRobot, operations: InProcessOperations, db: str, page: str, trouble: str | None = None
) -> dict[str, str]:
    return master_details(robot.master, db, mark=operations.blueprint_mark, page=page, trouble=trouble)


def _answering(
    robot: DemoRobot,
    operations: InProcessOperations,
    address: str,
    page: Callable[[], str],
    trouble: Callable[[], str | None],
) -> StatusServer:
    """The server that lets other commands see the robot and change it."""
    profile = robot.master.profile
    return StatusServer(
        robot.master.agent,
        what=MASTER,
        name=f"{profile.name} {profile.version}",
        details=lambda: _details(robot, operations, address, page(), trouble()),
        control=partial(perform, operations),
    )


def _make_page(
    robot: DemoRobot,
    operations: InProcessOperations,
    library: Library,
    database: tuple[Registry, RobotRecord, str],
    options: _Options,
    *,
    arena: RunningArena | None,
    desk: LessonController,
    change: Callable[[ChangeWish], None],
) -> RobotPages:
    from msbot_web.assembly import Database, RobotPages
    from msbot_web.demo_controls import seen_of
    from msbot_web.gallery import RunningDemo

    seen = seen_of(robot, asyncio.get_running_loop().time, arena)
    pages = RobotPages(
        robot.master,
        operations,
        library,
        database=Database(*database),
        seen=seen,
        settings=options.page.settings("demo"),
        demo=RunningDemo(options.choice, change),
        lessons=desk,
        space=options.space,
    )
    if options.before is not None:
        pages.service.accounts.take_over(options.before.entry_token, options.before.sessions)
    return pages


def _handover(wish: ChangeWish, robot: DemoRobot, room: RobotPages, options: _Options) -> Handover:
    entry_token, sessions = room.service.accounts.of_demo()
    stop = robot.master.stop
    left_s = None if options.seconds is None else max(options.seconds - robot.snapshot().at_s, 0.1)
    return Handover(
        wish.choice.robot,
        wish.choice.world,
        wish.lesson,
        wish.who,
        room.server.port,
        left_s,
        entry_token,
        sessions,
        stop.by,
        stop.reason,
        stop.stopped,
    )


async def _run_beside(work: Coroutine[object, object, None], beside: Iterable[Coroutine[object, object, None]]) -> None:
    """Run the robot, and its helpers as long as it runs."""
    with ungrouped(MsbotError):
        async with asyncio.TaskGroup() as tasks:
            helping = [tasks.create_task(helper) for helper in beside]
            await work
            for helper in helping:
                helper.cancel()


async def _run_served(
    server: SimBusServer,
    work: Callable[[], Coroutine[object, object, None]],
    beside: list[Coroutine[object, object, None]],
) -> None:
    """Let other programs join the bus while the robot runs."""

    async def when_served() -> None:
        await server.ready.wait()
        await work()

    await _run_beside(when_served(), [server.run(), *beside])


@contextlib.contextmanager
def _logging(robot: DemoRobot, path: Path | None) -> Iterator[None]:
    if path is None:
        yield
        return
    try:
        stream = path.open("w", encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot write the log {path}: {error.strerror}") from None
    with stream:
        robot.on_frame(FrameLog(stream, "sim0", epoch_s=time.time() - asyncio.get_running_loop().time()).tap)
        yield


def _check_script(script: list[ScriptStep], robot: DemoRobot) -> None:
    for step in script:
        if step.part and step.part not in robot.names:
            raise ConfigError(f"--script: there is no part {step.part!r}; there are {', '.join(robot.names)}")


async def _run(robot: DemoRobot, options: _Options, notes: Notes, script: ScriptRun) -> None:
    loop = asyncio.get_running_loop()
    on_end_signal(robot.finish)
    if options.seconds is not None:
        loop.call_later(options.seconds, robot.finish)
    playing = loop.create_task(script.run())
    try:
        if options.json:
            notes.say = partial(click.echo, err=True)
            await robot.run()
            script.end()
            click.echo(json.dumps(as_json(robot)))
        elif sys.stdout.isatty():
            await _run_live(robot, notes)
            notes.say = click.echo
            script.end()
        else:
            await _run_plain(robot, notes)
            script.end()
    finally:
        playing.cancel()


async def _run_live(robot: DemoRobot, notes: Notes) -> None:
    from rich.live import Live

    from msbot_web.cli.demo.terminal_table import keys_of, live_view

    keys = keys_of(robot.names)

    def view() -> RenderableType:
        return live_view(robot.snapshot(), robot.events, notes.lines, live.console.width, live.console.height)

    def pressed(key: str) -> None:
        if key in ("q", "\x03", "\x04"):
            robot.finish()
        elif key in keys:
            name = keys[key]
            (robot.unplug if robot.is_plugged(name) else robot.plug)(name)

    live = Live(screen=False, auto_refresh=False, vertical_overflow="crop")
    with KeyPresses(pressed), live:
        async with asyncio.TaskGroup() as tasks:
            drawing = tasks.create_task(_every(REFRESH_S, lambda: live.update(view(), refresh=True)))
            try:
                await robot.run()
            finally:
                drawing.cancel()


async def _run_plain(robot: DemoRobot, notes: Notes) -> None:
    def say(text: str) -> None:
        click.echo(text)
        sys.stdout.flush()

    robot.on_event(lambda event: say(event_words(event)))
    notes.say = say
    async with asyncio.TaskGroup() as tasks:
        reporting = tasks.create_task(_every(STATUS_S, lambda: say(status_words(robot.snapshot()))))
        try:
            await robot.run()
        finally:
            reporting.cancel()
    say(f"{robot.snapshot().robot} has ended.")


async def _every(seconds: float, action: Callable[[], None]) -> None:
    while True:
        await asyncio.sleep(seconds)
        action()
