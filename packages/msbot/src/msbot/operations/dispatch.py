"""Carries operations out: looks each up in the table, checks the right and the arguments, and calls its method.

Every change is checked, stored in one transaction and applied at once; the stored edit says who made it, and can be
undone. While the database cannot be written, nothing is changed, and the error says so.
"""

from __future__ import annotations

import asyncio
import inspect
from collections.abc import Callable, Mapping
from typing import Final

from msbot.config import Blueprint, Library, blueprint_mark
from msbot.master import Master
from msbot.operations.apply_blueprint import BlueprintChange
from msbot.operations.arguments import read_arguments, usable_arguments
from msbot.operations.blocking import Blocking, BusObjects, StoredBlocking
from msbot.operations.class_operations import ClassControl
from msbot.operations.described_parts import DescribedPartAdoption
from msbot.operations.last_manual_actions import LastActs, helps, places_of
from msbot.operations.manual_control import ManualControl
from msbot.operations.operation import EditLog, Operation, Outcome
from msbot.operations.placement import Placement
from msbot.operations.recording_operations import PartQueries, Recording
from msbot.operations.rights import Principal, user_of_computer
from msbot.operations.robot_log import RobotLog
from msbot.operations.running_robot import RunningRobot
from msbot.operations.service_calls import ServiceCalls
from msbot.operations.slot_configuration import SlotSettings, Wires
from msbot.operations.stand_ins import StandIns
from msbot.operations.stop_and_go import StopOperations
from msbot.operations.stored_robot import StoredPlacement, StoredRobot
from msbot.operations.table import OPERATIONS
from msbot.operations.teaching_operations import Faults, Lessons, Missions, Worlds
from msbot.operations.topic_inspection import TopicInspection, plain_fields
from msbot.operations.undo_operations import StoredUndoing, Undoing
from msbot.part import Message
from msbot.registry import Registry, RobotRecord
from msbot_agent.text.sentence import said, whole
from msbot_xrce.errors import ConfigError, DatabaseBusy, MsbotError
from msbot_xrce.lazy import dataclass

TOLD_AS_SAID: Final = ("stop", "go")
"""Operations that are told when they are said, because people have other ways to say them, too."""

SOMEBODY: Final = "somebody"
"""Who says STOP without a name."""


@dataclass(frozen=True, slots=True)
class PerformedOperation:
    """Something that was done to the robot."""

    who: str
    operation: str
    arguments: Mapping[str, object]
    """By the names of the table, so that the same can be asked for again."""
    words: str
    """What was done, in one sentence."""


class Operations:
    """What can be done to one robot.

    Args:
        *groups: the objects that carry out operations, by their methods with the names of operations.
    """

    def __init__(self, settings: SlotSettings, undoing: Undoing | StoredUndoing, *groups: object) -> None:
        self.settings = settings
        self.undoing = undoing
        self.asked = 0
        """Operations that may have changed something: when this count changes, caches of the robot's state are
        stale."""
        self._methods: dict[str, Callable[..., object]] = {
            name: getattr(group, name)
            for group in (settings, undoing, *groups)
            for name in OPERATIONS
            if hasattr(group, name)
        }
        self._checks: list[Callable[[Principal, Operation, Mapping[str, object]], None]] = []
        self.acts = LastActs()
        """Who did something last, and where."""
        self._one_at_a_time = asyncio.Lock()
        self._listeners: list[Callable[[PerformedOperation], object]] = []

    def on_asked(self, check: Callable[[Principal, Operation, Mapping[str, object]], None]) -> None:
        """Call the check before anything is done; it raises when that person may not do it now."""
        self._checks.append(check)

    def on_done(self, listener: Callable[[PerformedOperation], object]) -> None:
        """Call the listener with everything that was done; not with questions, nor with what could not be done."""
        self._listeners.append(listener)

    async def do(self, operation: str, /, *, who: Principal | str, **arguments: object) -> Outcome:
        """Do something to the robot, or ask something about it.

        Args:
            operation: its name in the table.
            who: who asks for it; a mere name is a user of this computer, who may do everything.
            **arguments: those that the table lists.

        Raises:
            ConfigError: there is no such operation, an argument is wrong, or it cannot be done; the text says why.
            RegistryError: it cannot be stored; nothing has changed.
        """
        row = OPERATIONS.get(operation)
        if row is None:
            raise ConfigError(
                said(
                    "there is no operation {operation!r}; there are {operations}",
                    operation=operation,
                    operations=", ".join(OPERATIONS),
                )
            )
        asker = user_of_computer(who) if isinstance(who, str) else who
        asker.require(row.right)
        given = usable_arguments(row, arguments) if row.drops_odd else read_arguments(row, arguments)
        about: dict[str, object] = {}
        if row.right_for_others is not None and not asker.may(row.right_for_others):
            own = await self.undoing.check_own(asker, row.right_for_others, given)
            given["edit"] = own.id  # what was checked, and not what somebody changes meanwhile
            about["slot"] = own.slot
        for check in self._checks:
            check(asker, row, about | given)
        method = self._methods.get(operation)
        if method is None:
            raise ConfigError(
                said(
                    "{operation} needs the robot's master, and it does not run: start it, `msbot master`",
                    operation=operation.replace("_", " "),
                )
            )
        if row.is_question:
            return await _outcome(method(**given))
        deed = {one.name: given[one.passed_as] for one in row.arguments if one.passed_as in given}
        self.asked += 1
        given["who"] = asker.name
        if row.takes_place:
            given["place"] = asker.place
        places = places_of(row.name, deed | about)
        # Before it is done: what comes of it may be seen before this answers.
        before = self.acts.note(asker.name, places, helps=helps(row))
        try:
            if row.kept not in (EditLog.UNDOABLE, EditLog.CHANGE):
                outcome = await _outcome(method(**given))
            else:
                async with self._one_at_a_time:  # what one has checked, another must not change before it is stored
                    outcome = await _outcome(method(**given))
        except BaseException:
            self.acts.take_back(before)
            raise
        if operation not in TOLD_AS_SAID:
            self._tell(PerformedOperation(asker.name, operation, deed, outcome.words))
        return outcome

    async def set_together(self, slot: str, values: Mapping[str, str | None], *, who: Principal) -> Outcome:
        """Set several parameters of a slot by hand, all or none; otherwise as the operation `set`.

        Raises:
            ConfigError: one cannot be set; nothing has changed.
            RegistryError: it cannot be stored; nothing has changed.
        """
        who.require(OPERATIONS["set"].right)
        for check in self._checks:
            check(who, OPERATIONS["set"], {"slot": slot})
        self.asked += 1
        before = self.acts.note(who.name, [slot])
        try:
            async with self._one_at_a_time:
                outcome = await self.settings.set_together(slot, values, who.name)
        except BaseException:
            self.acts.take_back(before)
            raise
        for name, value in values.items():
            self._tell(PerformedOperation(who.name, "set", {"slot": slot, "name": name, "value": value}, outcome.words))
        return outcome

    def _tell(self, deed: PerformedOperation) -> None:
        for listener in self._listeners:
            listener(deed)


class InProcessOperations(Operations):
    """The operations of a robot whose master runs in this process; must be made inside its event loop.

    Args:
        master: the robot.
        registry: its database; without one, operations that must be stored cannot be carried out.
        robot: which robot of the database it is.
        library: the part types that a new blueprint is checked against.
    """

    def __init__(
        self,
        master: Master,
        registry: Registry | None = None,
        robot: RobotRecord | None = None,
        *,
        library: Library | None = None,
    ) -> None:
        running = RunningRobot(master, registry, robot, library)
        self._running = running
        self._marked: tuple[Blueprint, str] | None = None
        self.applying = BlueprintChange(running)
        described = DescribedPartAdoption(running, self.applying)
        self.placement = Placement(running, described)
        self.stand_ins = StandIns(running, self.placement)
        self.stopping = StopOperations(
            running,
            on_said=self._stop_said,
        )
        self.showing = PartQueries(running)
        self.by_hand = ManualControl(running)
        self.service_calls = ServiceCalls(running)
        self.recording = Recording()
        self.faults = Faults(running)
        self.missions = Missions(running)
        self.lessons = Lessons(running)
        self.worlds = Worlds()
        self.topics = TopicInspection(running)
        self.log = RobotLog(running)
        self.pupils = ClassControl(running, self.lessons, self.by_hand, self.topics.slots_that_hear)
        super().__init__(
            SlotSettings(running),
            Undoing(running, self.placement),
            self.placement,
            self.stopping,
            self.showing,
            self.applying,
            self.by_hand,
            self.topics,
            self.service_calls,
            self.log,
            self.recording,
            self.faults,
            self.missions,
            self.lessons,
            self.worlds,
            self.pupils,
            Blocking(running),
            Wires(running),
            described,
            self.stand_ins,
            BusObjects(running),
        )
        self.on_asked(self.pupils.check)
        self.on_done(lambda deed: self.log.operation_done(deed.who, deed.operation, deed.arguments, deed.words))

    async def call_with(self, port: str, request: Message, seconds: float, *, who: Principal) -> Message:
        """The reply of a port that serves to a request that is a message already; otherwise as the operation `call`.

        Raises:
            ConfigError: it cannot be asked, or that person may not; the text says why.
            CallError: there is no reply; the text says why.
        """
        row = OPERATIONS["call"]
        who.require(row.right)
        for check in self._checks:
            check(who, row, {"port": port})
        self.asked += 1
        reply, words = await self.service_calls.exchange(port, request, seconds)
        fields = plain_fields(request)
        assert isinstance(fields, dict)
        values = [f"{name}={value}" for name, value in fields.items()]
        given = {"port": port, "values": values, "seconds": seconds}
        self._tell(PerformedOperation(who.name, row.name, given, words))
        return reply

    def _stop_said(self, operation: str, by: str, given: Mapping[str, object], words: str) -> None:
        if by not in self._running.slot_names():  # a STOP button is nobody's hand
            self.acts.note(by, places_of(operation, given), helps=helps(OPERATIONS[operation]))
        self._tell(PerformedOperation(by, operation, given, words))

    @property
    def blueprint(self) -> Blueprint:
        """What the robot is at present, with all that people have changed."""
        return self._running.blueprint

    @property
    def blueprint_mark(self) -> str:
        """The short mark of it, worked out when it has changed."""
        blueprint = self._running.blueprint
        if self._marked is None or self._marked[0] is not blueprint:
            self._marked = blueprint, blueprint_mark(blueprint)
        return self._marked[1]

    @property
    def library(self) -> Library | None:
        """The part types that are in force."""
        return self._running.library

    @property
    def stop_group(self) -> str:
        """The STOP group that the robot is in; empty: none."""
        return self._running.master.stop_group

    def filled(self) -> tuple[int, int]:
        """How many slots the robot has, and how many parts are in."""
        inventory = self._running.inventory
        return len(inventory.slots.names()), len(inventory.members())

    def on_library(self, listener: Callable[[Library], object]) -> None:
        """Call the listener with each new library: part types were added while the robot runs."""
        self._running.on_library(listener)


def stored_operations(registry: Registry, robot: RobotRecord) -> Operations:
    """The operations of a robot that is not running, on its database: they take effect at its next start.

    No master can start in the meantime.

    Raises:
        RegistryError: a master is running the robot, or the database cannot be used.
    """
    stored = StoredRobot(registry, robot)
    return Operations(
        SlotSettings(stored), StoredUndoing(stored), StoredPlacement(stored), StoredBlocking(stored), Wires(stored)
    )


async def perform(operations: Operations, request: Mapping[str, object]) -> dict[str, object]:
    """Do what another process asks for; a person's mistake is answered, not raised.

    A request is `{"do": name, "args": {...}, "who": name}`; the answer has `words`, plus `edit` if something was
    stored, or it has `error`, and `again` if the same may succeed a moment later.
    """
    do, who, arguments = request.get("do"), request.get("who"), request.get("args", {})
    try:
        if not isinstance(do, str) or do not in OPERATIONS:
            raise ConfigError(
                said("there is no operation {do!r}; there are {operations}", do=do, operations=", ".join(OPERATIONS))
            )
        if OPERATIONS[do].drops_odd:
            who = who if isinstance(who, str) and who else SOMEBODY
            arguments = usable_arguments(OPERATIONS[do], arguments)
        if not isinstance(who, str) or not who:
            raise ConfigError(said("{do}: it is not said who asks for it", do=do))
        if not isinstance(arguments, dict):
            raise ConfigError(said("{do}: the arguments must be an object", do=do))
        if "who" in arguments:  # who asks is said beside the arguments; no operation has one of that name
            read_arguments(OPERATIONS[do], arguments)
        return (await operations.do(do, who=whole(who), **arguments)).as_json()
    except DatabaseBusy as error:
        return {"error": str(error), "again": True}
    except MsbotError as error:
        return {"error": str(error)}


async def _outcome(result: object) -> Outcome:
    found = await result if inspect.isawaitable(result) else result
    assert isinstance(found, Outcome)
    return found
