"""What a person can do to a running robot: every change is checked, stored in one transaction, and applied at once.

The web pages, the command line and tests all come through here, so there is one meaning of each word. What is stored
can be undone; the database says who did what. While it cannot be written nothing is changed, and the error says so.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence

from msbot.config import Blueprint, Library
from msbot.errors import ConfigError
from msbot.master import Master
from msbot.operations.naming import describe, uid_of
from msbot.operations.outcome import Outcome, outcome_of
from msbot.operations.places import Places
from msbot.operations.running import Change, RunningRobot
from msbot.operations.stopping import Stopping, StopReport
from msbot.pnp import PartInfo
from msbot.registry import EditRecord, Registry, RobotRecord, ValueRecord

NEAR_EDITS = 50
"""Among so many there is nearly always one that can be undone."""
ALL_EDITS = 10_000
"""More than are kept."""

_log = logging.getLogger(__name__)


class Operations:
    """The operations of one running robot; every method is called in the robot's event loop and returns at once.

    Args:
        master: the robot.
        registry: its database; without one nothing can be stored, and what must be stored cannot be done.
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
        self._running = RunningRobot(master, registry, robot, library)
        self._inventory = master.inventory
        self._places = Places(self._running)
        self._stopping = Stopping(self._running)
        self._ignored: set[bytes] = set()

    # Places

    def adopt(self, part: str, slot: str | None = None, *, who: str) -> Outcome:
        """Put a part that stands by, or that the library does not know, into an empty slot.

        Args:
            part: its name, UID, address or part number.
            slot: where it goes; None: the one empty slot that fits.
            who: who decides.

        Raises:
            ConfigError: no such part or slot, the slot is taken, or the part does not fit and no window is open.
            RegistryError: it cannot be stored; nothing has changed.
        """
        return self._places.adopt(part, slot, who)

    def swap(self, slot: str, to_part: str, *, who: str) -> Outcome:
        """Put a part into a slot in place of the one that holds it, which gets the other's slot, or stands by.

        Raises:
            ConfigError: no such part or slot, or one of the two does not fit where it would go.
            RegistryError: it cannot be stored; nothing has changed.
        """
        return self._places.swap(slot, to_part, who)

    def release(self, slot: str, *, who: str) -> Outcome:
        """Take the part out of a slot; it stands by, and a spare gets the slot.

        Raises:
            ConfigError: no such slot, or it is empty.
            RegistryError: it cannot be stored; nothing has changed.
        """
        return self._places.release(slot, who)

    # The adoption window

    @property
    def window_s(self) -> float:
        """How long the adoption window stays open, seconds; 0 = it is closed."""
        return self._places.window_s

    @property
    def window_slot(self) -> str | None:
        """The slot that the next newcomer gets by itself; None: a person says."""
        return self._places.window_slot

    def open_window(self, seconds: float, slot: str | None = None, *, who: str) -> Outcome:
        """For some time, let parts be adopted that the library would turn away.

        Args:
            seconds: how long, 1 s to an hour.
            slot: an empty slot that the next newcomer gets without further ado; None: nobody gets in by itself.
            who: who decides.

        Raises:
            ConfigError: no such slot, it is taken, or the time is out of range.
        """
        return self._places.open_window(seconds, slot, who)

    def close_window(self, *, who: str = "") -> Outcome:
        """Let no strangers in any more; does nothing when the window is closed."""
        _log.info("the adoption window is closed by %s", who or "somebody")
        return self._places.close_window()

    # Who may come in

    def block(self, part_or_number: str, reason: str, *, who: str) -> Outcome:
        """Let a part, or all parts of a number, in no more; those that are in are put out at once.

        Raises:
            ConfigError: no such part or number.
            RegistryError: it cannot be stored; nothing has changed.
        """
        kind, key, words = self._block_key(part_or_number)
        edit = self._running.store(lambda registry, robot: registry.block(robot, kind, key, reason, who))
        self._inventory.blocks_changed(self._running.now())
        return outcome_of(edit, f"{words} is blocked{': ' if reason else ''}{reason}")

    def unblock(self, part_or_number: str, *, who: str) -> Outcome:
        """Let a part, or all parts of a number, in again; they come back by themselves.

        Raises:
            ConfigError: no such part or number, or it is not blocked.
            RegistryError: it cannot be stored; nothing has changed.
        """
        kind, key, words = self._block_key(part_or_number)
        uid, number = (bytes.fromhex(key), "") if kind == "uid" else (b"", key)
        if self._inventory.blocked(uid, number) is None:
            raise ConfigError(f"{words} is not blocked")
        edit = self._running.store(lambda registry, robot: registry.unblock(robot, kind, key, who))
        return outcome_of(edit, f"{words} may come in again")

    def ignore(self, part: str, who: str) -> Outcome:
        """Show a part that is not let in no more among the arrivals, until the master ends.

        Raises:
            ConfigError: no such part.
        """
        info = self._running.part(part, prefer=lambda one: not one.state.is_registered)
        self._ignored.add(_identity(info))
        _log.info("%s ignores %s", who, describe(info))
        return Outcome(f"{info.part} is not shown among the arrivals any more")

    def is_ignored(self, info: PartInfo) -> bool:
        """Whether somebody asked not to be shown this part among the arrivals."""
        return _identity(info) in self._ignored

    # Settings and wires

    def values(self, slot: str) -> Sequence[ValueRecord]:
        """The parameters of a slot, with values and where these come from.

        Raises:
            ConfigError: no such slot, or no database.
            RegistryError: the database cannot be read.
        """
        registry, robot = self._running.database()
        return registry.values(robot, self._running.slot(slot))

    def set_value(self, slot: str, parameter: str, value_text: str, *, who: str) -> Outcome:
        """Set a parameter of a slot by hand; its part gets it at once.

        Raises:
            ConfigError: no such slot or parameter, or the value is not allowed.
            RegistryError: it cannot be stored; nothing has changed.
        """
        target = self._running.slot(slot)
        found = self._running.parameter(target, parameter)
        value = found.read(value_text)
        return self._edited(lambda registry, robot: registry.set_value(robot, target, found.name, value, who))

    def reset_value(self, slot: str, parameter: str, *, who: str) -> Outcome:
        """Take back what was set by hand; blueprint or library hold again.

        Raises:
            ConfigError: no such slot or parameter, or it is not set by hand.
            RegistryError: it cannot be stored; nothing has changed.
        """
        target = self._running.slot(slot)
        found = self._running.parameter(target, parameter)
        if found.origin != "hand":
            raise ConfigError(f"{found.name} of {target} is not set by hand: its value is the {found.origin}'s")
        return self._edited(lambda registry, robot: registry.set_value(robot, target, found.name, None, who))

    def bind(
        self,
        topic: str,
        type_name: str,
        source: str | None,
        targets: Sequence[str] = (),
        *,
        reliable: bool = True,
        who: str,
    ) -> Outcome:
        """Join ports, written `SLOT.port`, by a topic; the parts follow at once.

        Raises:
            ConfigError: a port does not exist, or has another direction or type.
            RegistryError: it cannot be stored; nothing has changed.
        """
        start = None if source is None else self._running.endpoint(source)
        ends = [self._running.endpoint(target) for target in targets]
        return self._edited(
            lambda registry, robot: registry.bind(
                robot, topic, who, type_name=type_name, source=start, targets=ends, reliable=reliable
            )
        )

    def unbind(self, topic: str, endpoint: str | None = None, *, who: str) -> Outcome:
        """Take a port, or all ports, off a topic.

        Raises:
            ConfigError: no such topic, or the port is not bound to it.
            RegistryError: it cannot be stored; nothing has changed.
        """
        port = None if endpoint is None else self._running.endpoint(endpoint)
        return self._edited(lambda registry, robot: registry.unbind(robot, topic, port, who))

    def apply(self, blueprint: Blueprint, *, library: Library | None = None, who: str) -> Outcome:
        """Put a changed blueprint into force; parts whose slot is no more are delisted.

        Args:
            blueprint: what the robot is from now on.
            library: the part types it was checked against, if others than the robot was started with.
            who: who decides.

        Raises:
            ConfigError: it is another robot's blueprint, or there is no library or no database.
            RegistryError: it cannot be stored; nothing has changed.
        """
        registry, robot = self._running.database()
        types = library or self._running.library
        if types is None:
            raise ConfigError("this robot was started without its library: it cannot take another blueprint")
        profile = blueprint.robot
        if (profile.name, profile.serial_number) != (robot.name, robot.serial_number):
            raise ConfigError(
                f"this is the blueprint of {profile.name} {profile.serial_number}, and the robot that runs is "
                f"{robot.name} {robot.serial_number}: start another master for the other one"
            )
        newest = self._newest_edit()
        registry.apply_blueprint(blueprint, types, who)
        self._running.library = types
        before, self._running.master.blueprint = self._running.master.blueprint, blueprint
        self._inventory.reload(self._running.now())
        self._running.configure(slot.name for slot in blueprint.slots)
        edit = self._newest_edit()
        if edit is None or (newest is not None and edit.id == newest.id):
            return Outcome("the blueprint changes nothing")
        words = edit.words
        if (before.timing, before.robot, before.options) != (blueprint.timing, blueprint.robot, blueprint.options):
            words += "; profile, timing and options hold from the master's next start on"
        return Outcome(words, edit.id)

    # Taking back

    def undo(self, edit_id: int | None = None, *, who: str) -> Outcome:
        """Take back a change, the newest that was not taken back if none is named.

        Raises:
            ConfigError: there is none, it was changed again since, or a part that shall come back is not plugged in.
            RegistryError: it cannot be stored; nothing has changed.
        """
        registry, robot = self._running.database()
        if (meant := self._meant(edit_id)) is not None:
            self._places.check_undo(meant)
        edit = registry.undo(robot, edit_id, who)
        self._inventory.reload(self._running.now())
        self._inventory.blocks_changed(self._running.now())
        slots = self._inventory.slots.names()
        self._running.configure(slot for slot in edit.slots if slot in slots)
        self._places.follow(edit, who)
        return outcome_of(edit)

    def edits(self, limit: int = 50) -> Sequence[EditRecord]:
        """What people changed lately, the newest first.

        Raises:
            ConfigError: there is no database.
            RegistryError: it cannot be read.
        """
        registry, robot = self._running.database()
        return registry.edits(robot, limit)

    # STOP and finding

    def stop(self, reason: str = "", *, who: str) -> Outcome:
        """STOP: every part goes to its safe state and stays there until `go_on`; parts that come in are told, too."""
        return self._stopping.stop(reason, who)

    def go_on(self, *, who: str) -> Outcome:
        """End STOP.

        Raises:
            ConfigError: nobody said STOP.
        """
        return self._stopping.go_on(who)

    @property
    def stop_report(self) -> StopReport | None:
        """The STOP that holds: who said it, how many parts have confirmed it, and how long that took."""
        return self._stopping.report

    def identify(self, part: str) -> Outcome:
        """Have a part show itself: blink, beep, whatever it can.

        Raises:
            ConfigError: no such part, or it cannot be told.
        """
        info = self._running.part(part, prefer=lambda one: one.state.is_registered)
        if not self._running.master.inventory_service.identify(info.client_key):
            raise ConfigError(f"{info.part} cannot be told to show itself: its program speaks the thesis' layout only")
        return Outcome(f"{info.part} shows itself")

    def why(self, part: str) -> list[str]:
        """In sentences: how a part stands and which rules led there; nothing when no part is known by that word."""
        now = self._running.now()
        return self._inventory.why(part, now) if self._inventory.find(part, now) else []

    # Helpers

    def _edited(self, change: Change) -> Outcome:
        edit = self._running.store(change)
        self._running.configure(edit.slots)
        return outcome_of(edit)

    def _meant(self, number: int | None) -> EditRecord | None:
        """The edit that an undo is about."""
        newest = self._newest_edit()
        if newest is None:
            return None
        if number is not None:  # numbers count up, so it is not farther away than that
            near = self.edits(max(1, newest.id - number + 1))
            return next((edit for edit in near if edit.id == number), None)
        for limit in (NEAR_EDITS, ALL_EDITS):
            found = next((edit for edit in self.edits(limit) if edit.can_be_undone), None)
            if found is not None:
                return found
        return None

    def _newest_edit(self) -> EditRecord | None:
        return next(iter(self.edits(1)), None)

    def _block_key(self, word: str) -> tuple[str, str, str]:
        """(kind, key, words) of what a person means to block."""
        library = self._running.library
        seen = {info.part_number for info in self._inventory.view(self._running.now())}
        if word in seen or (library is not None and library.get(word) is not None):
            return "number", word, f"part number {word}"
        if (uid := uid_of(word)) is not None:
            return "uid", uid.hex(), f"the part with UID {uid.hex()}"
        found = self._inventory.find(word, self._running.now())
        info = found[0] if len(found) == 1 else self._running.part(word)  # also one that is gone
        if info.uid:
            return "uid", info.uid.hex(), f"{info.part} (UID {info.uid.hex()})"
        raise ConfigError(f"{info.part} has no UID by which it could be blocked: block its number, {info.part_number}")


def _identity(info: PartInfo) -> bytes:
    return info.uid or info.client_key.to_bytes(4, "big")
