"""The running robot that operations act on: its master, its database, and what people mean by their words."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Container, Coroutine, Iterable, Sequence
from typing import Protocol, TypeVar

from msbot.config import Blueprint, Library, SlotPort
from msbot.master import Master
from msbot.operations.part_names import one_part, one_slot, uid_of
from msbot.pnp import PartInfo, PartState
from msbot.registry import EditKind, EditRecord, Registry, RobotRecord
from msbot.registry.edits.editing import Making, NotedLine
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError

_T = TypeVar("_T")
EMPTY = "empty"
"""The state of a slot without a part."""
_WAITING = (PartState.CHECKING, PartState.STANDBY)


class RunningRobot:
    """A master and its database; must be made inside the robot's event loop.

    Args:
        master: the robot.
        registry: its database; None: nothing can be stored.
        robot: the robot's record in the database.
        library: the part types that a new blueprint is checked against.
    """

    def __init__(
        self, master: Master, registry: Registry | None, robot: RobotRecord | None, library: Library | None
    ) -> None:
        self.master = master
        self.inventory = master.inventory
        self.registry = registry
        self.robot = robot
        self.library = library
        self._library_listeners: list[Callable[[Library], object]] = []
        self.loop = asyncio.get_running_loop()
        self._tasks: set[asyncio.Task[None]] = set()
        if registry is not None and robot is not None:
            registry.runs.on_news(robot, lambda: self.loop.call_soon_threadsafe(self.follow_database))

    @property
    def blueprint(self) -> Blueprint:
        """What the robot is at present; without a database what it was started with."""
        if self.registry is None or self.robot is None:
            return self.master.blueprint
        return self.registry.runs.store(self.robot).blueprint

    def now(self) -> float:
        """The present time, seconds."""
        return self.loop.time()

    def on_library(self, listener: Callable[[Library], object]) -> None:
        """Have it called with the part types whenever others are in force."""
        self._library_listeners.append(listener)

    def use_library(self, library: Library) -> None:
        """From now on these part types are in force, for all who have the library: the pages, too."""
        if self.library is None:
            self.library = library
        self.library.become(library)
        self.master.library = self.library
        for listener in self._library_listeners:
            listener(self.library)

    # Finding

    def part(self, word: str, *, prefer: Callable[[PartInfo], bool] = lambda _: True) -> PartInfo:
        """The one part that a person means, out of those that are present.

        Raises:
            ConfigError: none, or several.
        """
        everybody = self.inventory.view(self.now())
        found = self.inventory.find(word, self.now())
        if not found and (uid := uid_of(word)) is not None:
            found = [info for info in everybody if info.uid == uid]
        return one_part(word, found, everybody, prefer)

    def check_named(self, word: str) -> None:
        """Check that somebody who sees neither UIDs nor addresses has named a part.

        Raises:
            NotThere: no part has that name; whether one has that UID or address, nobody learns.
        """
        if not self.inventory.find(word, self.now(), by_name=True):
            one_part(word, [], self.inventory.view(self.now()), lambda _: True)

    def present_part(self, uid: bytes) -> PartInfo | None:
        """The part with that UID, if it is present."""
        everybody = self.inventory.view(self.now())
        return next((info for info in everybody if info.uid == uid and not info.state.is_over), None)

    def people_here(self, own: Container[bytes]) -> list[str]:
        """The programs and parts that people run here: a pupil's by its pupil and slot, others by their part.

        Args:
            own: the UIDs of the robot's own simulated parts, which are nobody's.
        """
        found: list[str] = []
        for info in self.inventory.view(self.now()):
            if (info.state.is_registered or info.state in _WAITING) and info.uid not in own:
                pupil = self.inventory.pupil_parts.pupil_of(info.client_key)
                name = f"{pupil} ({info.slot})" if pupil and info.slot else pupil or info.part
                if name not in found:
                    found.append(name)
        return found

    def holder(self, slot: str) -> PartInfo | None:
        """The part that holds a slot."""
        return self.inventory.holder(slot, self.now())

    def state_of(self, slot: str) -> str:
        """The state of the part in a slot, or of the one that was there last; `empty`: none was."""
        holder = self.holder(slot)
        if holder is not None:
            return holder.state.value
        gone = [info for info in self.inventory.view(self.now()) if info.slot == slot and info.state.is_over]
        return min(gone, key=lambda info: info.state_age_s).state.value if gone else EMPTY

    def is_in_state(self, slot: str, state: str) -> bool:
        """Whether the part in a slot is in a state, or the one that was there last; `empty`: there is none now."""
        return self.holder(slot) is None if state == EMPTY else self.state_of(slot) == state

    def slot_names(self) -> Sequence[str]:
        """See `ChangeableRobot.slot_names`."""
        return self.inventory.slots.names()

    # Storing

    def database(self) -> tuple[Registry, RobotRecord]:
        """The database, and this robot's record in it.

        Raises:
            ConfigError: there is none.
        """
        if self.registry is None or self.robot is None:
            raise ConfigError(said("this robot runs without a database: what is to last cannot be changed"))
        return self.registry, self.robot

    async def read(self, read: Callable[[Registry, RobotRecord], _T]) -> _T:
        """See `ChangeableRobot.read`."""
        registry, robot = self.database()
        return await registry.storage.in_time(read, registry, robot)

    async def change(self, who: str, making: Making) -> EditRecord:
        """See `ChangeableRobot.change`."""
        registry, robot = self.database()
        edit = await registry.edits.make_soon(robot, who, making)
        self.configure(edit.slots)
        return edit

    def note(self, kind: EditKind, words: str, who: str) -> NotedLine:
        """Record something that changed nothing in the database; nobody waits for it."""
        if self.registry is None or self.robot is None:
            return NotedLine()
        return self.registry.edits.note(self.robot, kind, words, who)

    def note_again(self, line: NotedLine, words: str) -> None:
        """Have that line say something else."""
        if self.registry is not None:
            self.registry.edits.note_again(line, words)

    def run_later(self, work: Coroutine[object, object, None]) -> None:
        """Do something in the event loop that nobody waits for."""
        task = self.loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def follow_database(self) -> None:
        """Bring the robot in line with the database, which somebody else has changed."""
        self.inventory.reload(self.now())
        self.inventory.blocks_changed(self.now())
        self.configure(self.slot_names())

    def configure(self, slots: Iterable[str]) -> None:
        """Give the parts in these slots their new configurations.

        Raises:
            RegistryError: one cannot be read.
        """
        for slot in slots:
            self.inventory.configuration_changed(slot)


# What the operations that work on any robot need from it, whether its master is running or not.


class ChangeableRobot(Protocol):
    """A running robot, or the database of one that is not running."""

    @property
    def library(self) -> Library | None:
        """The part types of a running robot."""

    def slot_names(self) -> Sequence[str]:
        """Its slots, in the order of the blueprint."""

    async def read(self, read: Callable[[Registry, RobotRecord], _T]) -> _T:
        """Read something from the database.

        Raises:
            ConfigError: there is no database.
            RegistryError: it cannot be read.
        """

    async def change(self, who: str, making: Making) -> EditRecord:
        """Make a change in the database; parts whose configuration changes get the new one.

        Raises:
            ConfigError: there is no database, or the change makes no sense.
            RegistryError: it cannot be stored; nothing has changed.
        """


def slot_of(robot: ChangeableRobot, name: str) -> str:
    """The slot of that name; case does not matter if the name is unambiguous.

    Raises:
        NotThere: there is none.
    """
    return one_slot(name, robot.slot_names())


def endpoint_of(robot: ChangeableRobot, text: str) -> SlotPort:
    """The port written as `SLOT.port`.

    Raises:
        ConfigError: it is not a port, or there is no such slot.
    """
    slot, _, port = text.rpartition(".")
    if not slot or not port:
        raise ConfigError(said("{text!r} is not a port: write SLOT.port, for example AA.out", text=text))
    return SlotPort(slot_of(robot, slot), port)
