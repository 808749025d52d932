"""Driving a port by hand: a person controls the fan, the lamp, the servo in place of the wire that leads there.

A person who drives a port holds it for a while. Each new value extends the hold; when nobody renews it, the port gets
its safe value and is connected to its wire again. STOP ends the hold at once.
"""

from __future__ import annotations

import asyncio
import logging
import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence

from msbot.config import BoundedText, Direction, FieldKind, LeafType, ListType, MessageType, Port, Scalar
from msbot.operations.operation import Outcome
from msbot.operations.running_robot import RunningRobot, endpoint_of
from msbot.part import Message
from msbot.part.messages.leaves import leaves_of
from msbot.pnp import HeldPort, StopStatus, message_words
from msbot.registry import EditKind
from msbot.sim.model_part import message_of
from msbot_agent.space import Qos, Topic, Writer
from msbot_agent.text.sentence import said
from msbot_agent.text.similar_names import instead_of
from msbot_xrce.errors import ConfigError, RegistryError
from msbot_xrce.lazy import dataclass

REPEAT_S = 0.5
"""Period in which the value is repeated while the port is held, in case its reader came after the first time."""
LETTING_GO_S = 0.3
"""How long the safe value is published before the wire is connected again."""
_GUID = bytes.fromhex("4d73424f540000000000000068616e64")
"""The writer's identity in the data space: `MsBOT`, `hand`."""

_log = logging.getLogger(__name__)

MOST_SHOWN = 4
"""Values that the words of a mistake repeat."""
_FIELD = re.compile(r"[A-Za-z_][A-Za-z0-9_.]*")
"""What stands before a `=` and looks like the name of a field, so that a misspelt one is not taken for a text."""


@dataclass(slots=True)
class _Hold:
    """A port that is held."""

    held: HeldPort
    message: Message
    safe: Message | None
    writer: Writer
    who: str
    until: float
    timer: asyncio.TimerHandle | None = None
    ending: bool = False


class ManualControl:
    """The ports of one running robot that people hold."""

    def __init__(self, running: RunningRobot) -> None:
        self._running = running
        self._holds: dict[tuple[str, str], _Hold] = {}
        running.master.on_stop(self._stopped)

    def publish(self, port: str, values: Sequence[str], seconds: float, who: str) -> Outcome:
        """Drive a port with these values, and hold it for this many seconds."""
        if self._running.master.stop.stopped:
            raise ConfigError(said("STOP is in force: {port} stays in its safe state until GO", port=port))
        end = endpoint_of(self._running, port)
        holder = self._running.holder(end.slot)
        if holder is None or not holder.state.is_registered:
            raise ConfigError(said("slot {slot} has no part now: there is nothing to drive", slot=end.slot))
        declared = self._port(end.slot, end.port, holder.part_number)
        assert declared.message is not None
        message = read_message(f"{end.slot}.{end.port}", declared.message, values)
        check_ranges(str(end), declared, message)
        hold = self._holds.get((end.slot, end.port))
        if hold is None or hold.ending:
            hold = self._take(declared, end.slot, message, who)
            self._running.note(
                EditKind.HAND, said("{who} drives {slot}.{port} by hand", who=who, slot=end.slot, port=end.port), who
            )
        hold.message, hold.who = message, who
        hold.until = self._running.now() + seconds
        self._say(hold)
        shown = message_words(message, declared.message.units)
        return Outcome(
            said(
                "{slot}.{port}: {shown}, for {seconds:g} s", slot=end.slot, port=end.port, shown=shown, seconds=seconds
            )
        )

    def let_go(self, port: str, who: str) -> Outcome:
        """Release a port: it gets its safe value, then what its wire carries."""
        end = endpoint_of(self._running, port)
        hold = self._holds.get((end.slot, end.port))
        if hold is None or hold.ending:
            raise ConfigError(said("nobody drives {port} by hand", port=port))
        hold.who = who
        self._end(hold)
        return Outcome(said("{port} gets its safe value and follows its wire again", port=port))

    def end_those_of(self, people: Collection[str]) -> None:
        """Release the ports that these people hold: each gets its safe value, then its wire."""
        self.end_where(lambda _slot, who: who in people)

    def end_where(self, is_over: Callable[[str, str], bool]) -> None:
        """The same for those of which `(slot, who holds it)` is true."""
        for hold in list(self._holds.values()):
            if not hold.ending and is_over(hold.held.slot, hold.who):
                self._end(hold)

    def held_ports(self) -> Mapping[tuple[str, str], str]:
        """Who drives which port: `(slot, port)` -> name."""
        return {where: hold.who for where, hold in self._holds.items() if not hold.ending}

    def sent_values(self) -> Mapping[tuple[str, str], Mapping[str, Scalar]]:
        """What people send to the ports that they hold: `(slot, port)` -> fields."""
        return {where: leaves_of(hold.message) for where, hold in self._holds.items() if not hold.ending}

    def _stopped(self, status: StopStatus) -> None:
        if status.stopped:
            for hold in list(self._holds.values()):
                self._join_again(hold)

    def _port(self, slot: str, name: str, number: str) -> Port:
        library = self._running.library
        part_type = None if library is None else library.find(number)
        if part_type is None:
            raise ConfigError(
                said(
                    "the library does not know {number}: nobody can say what {slot}.{name} takes",
                    number=number,
                    slot=slot,
                    name=name,
                )
            )
        declared = part_type.port(name)
        drivable = [one.name for one in part_type.ports if one.direction is Direction.SUBSCRIBE and one.message]
        if declared is None or declared.name not in drivable:
            known = ", ".join(f"{slot}.{one}" for one in drivable) or "it has none"
            raise ConfigError(
                said(
                    "{slot}.{name} is not a port that can be driven; those of {number}: {known}",
                    slot=slot,
                    name=name,
                    number=number,
                    known=known,
                )
            )
        return declared

    def _take(self, declared: Port, slot: str, message: Message, who: str) -> _Hold:
        inventory = self._running.inventory
        assert declared.message is not None
        old = self._holds.pop((slot, declared.name), None)
        if old is not None:
            self._drop(old)
        held = inventory.hand.take(slot, declared.name, message.type_name)
        try:
            self._running.configure([slot])
        except RegistryError:
            inventory.hand.let_go(slot, declared.name)
            raise
        place = self._running.blueprint.slot(slot)
        stated = declared.safe if place is None else place.safe_at(declared)
        safe = message_of(declared.message, stated) if stated else None
        writer = self._running.master.space.writer(Topic(held.topic, held.type_name), Qos(), _GUID)
        hold = _Hold(held, message, safe, writer, who, self._running.now())
        self._holds[slot, declared.name] = hold
        return hold

    def _say(self, hold: _Hold) -> None:
        if hold.timer is not None:
            hold.timer.cancel()
        if self._running.now() >= hold.until and not hold.ending:
            self._end(hold)
            return
        hold.writer.write(hold.message.encode())
        hold.timer = self._running.loop.call_later(REPEAT_S, self._say, hold)

    def _end(self, hold: _Hold) -> None:
        """The safe value first, then the wire."""
        hold.ending = True
        if hold.timer is not None:
            hold.timer.cancel()
        if hold.safe is not None:
            hold.writer.write(hold.safe.encode())
        hold.timer = self._running.loop.call_later(LETTING_GO_S, self._join_again, hold)

    def _join_again(self, hold: _Hold) -> None:
        where = hold.held.slot, hold.held.port
        if self._holds.get(where) is not hold:
            return
        del self._holds[where]
        self._drop(hold)
        self._running.inventory.hand.let_go(*where)
        try:
            self._running.configure([where[0]])
        except RegistryError as error:
            _log.warning("%s.%s follows its wire again when its part comes back: %s", *where, error)
        self._running.note(EditKind.HAND, said("{where} is no longer driven by hand", where=".".join(where)), hold.who)

    def _drop(self, hold: _Hold) -> None:
        if hold.timer is not None:
            hold.timer.cancel()
        hold.writer.close()


def check_ranges(where: str, declared: Port, message: Message) -> None:
    """Check the ranges that a port declares.

    Raises:
        ConfigError: a value is out of its range.
    """
    leaves = leaves_of(message)
    for name in declared.ranges:
        if fault := declared.fault(name, leaves[name]):
            raise ConfigError(f"{where}: {name} {fault}")


def read_message(where: str, message: MessageType, values: Sequence[str]) -> Message:
    """The message that people mean: values in the order of the fields, or `field=value`.

    Args:
        where: the port or topic that takes it, for the words of a mistake.
        message: its type.
        values: what people wrote.

    Raises:
        ConfigError: a field is missing, unknown, or cannot have that value.
    """
    fields = message.leaves
    shown = ", ".join(f"{name} ({kind.word})" for name, kind in fields.items())
    values = _without_type(message, values)
    if len(fields) == 1 and _is_text(next(iter(fields.values()))):
        values = [" ".join(values)]  # a sentence needs no quotes
    if len(values) > len(fields):
        if len(fields) == 1 and isinstance(next(iter(fields.values())), ListType):
            written = f"'[{', '.join(values[:MOST_SHOWN])}{', ...' if len(values) > MOST_SHOWN else ''}]'"
            raise ConfigError(said("{where} takes one list: write {written}", where=where, written=written))
        if len(fields) == 1:
            raise ConfigError(
                said("{where} takes one value, not {count}: {shown}", where=where, count=len(values), shown=shown)
            )
        raise ConfigError(
            said(
                "{where} takes {count} values, not {count2}: {shown}",
                where=where,
                count=len(fields),
                count2=len(values),
                shown=shown,
            )
        )
    given: dict[str, str] = {}
    for place, text in enumerate(values):
        name, equals, value = text.partition("=")
        if equals and name not in fields and _FIELD.fullmatch(name):
            raise _no_field(where, name, list(fields)[place], fields, text)
        if not equals or name not in fields:
            name, value = list(fields)[place], text
        if name in given:
            raise ConfigError(said("{where} has two values for {name}", where=where, name=name))
        given[name] = value
    if missing := [name for name in fields if name not in given]:
        raise ConfigError(
            said(
                "{where} needs a value for {missing}; it takes {shown}",
                where=where,
                missing=", ".join(missing),
                shown=shown,
            )
        )
    return message_of(message, {name: _value(where, name, fields[name], given[name]) for name in fields})


def _without_type(message: MessageType, values: Sequence[str]) -> Sequence[str]:
    """The values, without the type that people write in front of them for other tools."""
    if len(values) < 2 or values[0].rpartition("/")[2] != message.name:
        return values
    fields = message.leaves
    is_named = values[1].partition("=")[0] in fields and "=" in values[1]
    is_sentence = len(fields) == 1 and _is_text(next(iter(fields.values())))
    return values[1:] if is_named or (len(values) == len(fields) + 1 and not is_sentence) else values


def _no_field(where: str, name: str, here: str, fields: Mapping[str, LeafType], text: str) -> ConfigError:
    hint = instead_of(name, fields)
    if not _is_text(fields[here]):
        return ConfigError(said("{where} has no field {name!r}; {hint}", where=where, name=name, hint=hint))
    return ConfigError(
        said(
            "{where} has no field {name!r} (a text is written {written}); {hint}",
            where=where,
            name=name,
            hint=hint,
            written=f"{here}={text}",
        )
    )


def _is_text(kind: LeafType) -> bool:
    return kind is FieldKind.TEXT or isinstance(kind, BoundedText)


def _value(where: str, name: str, kind: LeafType, text: str) -> Scalar:
    value: Scalar
    try:
        if kind is FieldKind.TEXT or not isinstance(kind, FieldKind):
            value = text
        elif kind is FieldKind.BOOL:
            value = {"true": True, "on": True, "1": True, "false": False, "off": False, "0": False}[text.casefold()]
        else:
            value = int(text, 0) if kind.is_whole else float(text)
    except (KeyError, ValueError):
        needed = "on or off" if kind is FieldKind.BOOL else "a whole number" if kind.is_whole else "a number"
        raise ConfigError(
            said("{where}: {name} must be {needed}, not {text!r}", where=where, name=name, needed=needed, text=text)
        ) from None
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(
            said("{where}: {name} must be {needed}, not {text!r}", where=where, name=name, needed="a number", text=text)
        )
    if fault := kind.fault(value):
        raise ConfigError(f"{where}: {name} {fault}")
    return value
