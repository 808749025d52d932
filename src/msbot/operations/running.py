"""The running robot that operations are about: its master, its database, and what people mean by their words."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable

from msbot.config import Endpoint, Library
from msbot.errors import ConfigError, RegistryError
from msbot.master import Master
from msbot.operations.naming import one_part, one_slot, uid_of
from msbot.pnp import PartInfo
from msbot.registry import EditRecord, Registry, RobotRecord, ValueRecord

_log = logging.getLogger(__name__)

Change = Callable[[Registry, RobotRecord], EditRecord]
"""One transaction."""


class RunningRobot:
    """A master and its database; must be made inside the robot's event loop.

    Args:
        master: the robot.
        registry: its database; None: nothing can be stored.
        robot: which robot of the database it is.
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
        self.loop = asyncio.get_running_loop()

    def now(self) -> float:
        """The present time, seconds."""
        return self.loop.time()

    # Finding

    def part(self, word: str, *, prefer: Callable[[PartInfo], bool] = lambda _: True) -> PartInfo:
        """The one part that is there and is meant.

        Raises:
            ConfigError: none, or several.
        """
        everybody = self.inventory.view(self.now())
        found = self.inventory.find(word, self.now())
        if not found and (uid := uid_of(word)) is not None:
            found = [info for info in everybody if info.uid == uid]
        return one_part(word, found, everybody, prefer)

    def here(self, uid: bytes) -> PartInfo | None:
        """The part with that UID, if it is there."""
        everybody = self.inventory.view(self.now())
        return next((info for info in everybody if info.uid == uid and not info.state.is_over), None)

    def holder(self, slot: str) -> PartInfo | None:
        """The part that holds a slot."""
        return self.inventory.holder(slot, self.now())

    def slot(self, name: str) -> str:
        """The slot of that name.

        Raises:
            ConfigError: there is none.
        """
        return one_slot(name, self.inventory.slots.names())

    def endpoint(self, text: str) -> Endpoint:
        """The port that is written `SLOT.port`.

        Raises:
            ConfigError: it is none, or there is no such slot.
        """
        return read_endpoint(text, self.inventory.slots.names())

    def parameter(self, slot: str, name: str) -> ValueRecord:
        """A parameter of a slot.

        Raises:
            ConfigError: there is none of that name.
            RegistryError: the database cannot be read.
        """
        registry, robot = self.database()
        return one_parameter(registry.values(robot, slot), slot, name)

    # Storing

    def database(self) -> tuple[Registry, RobotRecord]:
        """The database and which robot of it this is.

        Raises:
            ConfigError: there is none.
        """
        if self.registry is None or self.robot is None:
            raise ConfigError("this robot runs without a database: what is to last cannot be changed")
        return self.registry, self.robot

    def store(self, change: Change) -> EditRecord:
        """Make a change in the database.

        Raises:
            ConfigError: there is no database, or the change makes no sense.
            RegistryError: it cannot be stored; nothing has changed.
        """
        registry, robot = self.database()
        return change(registry, robot)

    def store_if_any(self, change: Change) -> EditRecord | None:
        """The same, for what can be done without a database, too."""
        return None if self.registry is None or self.robot is None else change(self.registry, self.robot)

    def note(self, kind: str, words: str, who: str) -> None:
        """Keep a line about something that changed nothing stored; soon, so that nobody waits for the database."""
        self.loop.call_soon(self._store_note, kind, words, who)

    def _store_note(self, kind: str, words: str, who: str) -> None:
        try:
            self.store_if_any(lambda registry, robot: registry.note(robot, kind, words, who))
        except RegistryError as error:
            _log.warning("%s; this was not stored: %s", words, error)

    def configure(self, slots: Iterable[str]) -> None:
        """Give the parts in these slots their new configurations.

        Raises:
            RegistryError: one cannot be read.
        """
        for slot in slots:
            self.inventory.configuration_changed(slot)


def read_endpoint(text: str, slots: Iterable[str]) -> Endpoint:
    """The port that is written `SLOT.port`.

    Raises:
        ConfigError: it is none, or there is no such slot.
    """
    slot, _, port = text.rpartition(".")
    if not slot or not port:
        raise ConfigError(f"{text!r} is no port: write SLOT.port, for example AA.out")
    return Endpoint(one_slot(slot, slots), port)


def one_parameter(values: Iterable[ValueRecord], slot: str, name: str) -> ValueRecord:
    """The parameter of that name.

    Raises:
        ConfigError: there is none.
    """
    known = {value.name: value for value in values}
    if name not in known:
        raise ConfigError(f"slot {slot} has no parameter {name!r}; it has {', '.join(known) or 'none'}")
    return known[name]
