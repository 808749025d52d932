"""What a person's wish for a fault means in a running robot: checked, completed, and turned into an effect."""

from __future__ import annotations

from random import Random

from msbot.operations.fault_request import FaultRequest
from msbot.operations.running_robot import RunningRobot
from msbot.sim import make_simulator
from msbot_agent.link import Disturbance
from msbot_agent.link.can.sim import SimBusDriver
from msbot_agent.text.sentence import said
from msbot_agent.text.similar_names import instead_of
from msbot_school.faults.effects import (
    BabblingNode,
    BitErrors,
    BrokenSender,
    CombinedEffect,
    DatabaseUnavailable,
    DistortedReadings,
    Effect,
    GuestPartHub,
    PartsHere,
    UnexpectedPart,
    UnpluggedPart,
)
from msbot_school.faults.fault_engine import FOR_S, FaultSpec
from msbot_school.faults.fault_kinds import (
    KINDS,
    LOAD,
    Condition,
    FaultKind,
    InjectionPoint,
    NumberCondition,
    kind_named,
    read_condition,
)
from msbot_school.faults.packet_treatments import (
    DelayedBurst,
    DriftingValue,
    ErrorTolerantTreatment,
    FrozenLink,
    LinkInterceptors,
    PacketFaultEffect,
    PacketTreatment,
    SlowReceiver,
    StuckValue,
)
from msbot_school.faults.port_values import LatestPortValues
from msbot_xrce.errors import ConfigError

WRONG_KEY = bytes(range(16, 32))
OVERTAKEN_S = 0.25
"""How long a packet waits that others overtake: parts send some ten times a second."""


class FaultFactory:
    """Makes effects for one running robot.

    Args:
        running: the robot.
        parts: its parts that are simulated in this process.
        bus: its simulated bus; None: it has none.
        numbers: what conditions look at.
    """

    def __init__(
        self, running: RunningRobot, parts: PartsHere, bus: SimBusDriver | None, numbers: LatestPortValues
    ) -> None:
        self._running = running
        self._parts = parts
        self._bus = bus
        self._numbers = numbers
        self._edge = LinkInterceptors(running)
        self._guests = GuestPartHub(running)

    def spec(self, wish: FaultRequest) -> FaultSpec:
        """The fault that a person means.

        Raises:
            ConfigError: there is none like that; the text says what would be right.
        """
        kind = kind_named(wish.kind)
        at = self._at(kind, wish.at)
        given = {"jitter": wish.jitter_ms, "port": wish.port, "number": wish.number}
        for option, value in given.items():
            if value and option not in kind.options:
                raise ConfigError(said("{kind} takes no --{option}", kind=kind.name, option=option))
        amount = 0.0
        if kind.amount is not None:
            amount = self._default(kind) if wish.amount is None else wish.amount
            if not kind.amount.least <= amount <= kind.amount.most:
                raise ConfigError(
                    said(
                        "{kind}: {amount:g} {unit} is not possible; it is {least:g} to {most:g} {unit}",
                        kind=kind.name,
                        amount=amount,
                        unit=kind.amount.unit,
                        least=kind.amount.least,
                        most=kind.amount.most,
                    )
                )
        elif wish.amount is not None:
            raise ConfigError(said("{kind} takes no --{option}", kind=kind.name, option="amount"))
        when = read_condition(wish.when) if wish.when else None
        self.check_condition(when)
        return FaultSpec(
            kind,
            at,
            amount,
            wish.jitter_ms or 0.0,
            wish.port,
            wish.number,
            wish.after_s,
            FOR_S if wish.for_s is None else wish.for_s,
            when,
            wish.chance,
            1 if wish.seed is None else wish.seed,
            hidden=wish.hidden,
        )

    def _default(self, kind: FaultKind) -> float:
        assert kind.amount is not None
        if kind.name != "late":
            return kind.amount.default
        timing = self._running.inventory.timing
        # Late, and not yet lost.
        return (timing.late_s + timing.shortest_detection_s) / 2 + timing.beat_s / 2

    def _at(self, kind: FaultKind, at: str) -> str:
        if not kind.at_part:
            if at:
                raise ConfigError(
                    said("{kind} is planted at the robot as a whole: leave {at} out", kind=kind.name, at=at)
                )
            return ""
        if not at:
            raise ConfigError(said("{kind} is planted at a part: name its slot", kind=kind.name))
        if at in self._running.slot_names():
            return at
        info = self._running.part(at)
        if info.slot is None:
            raise ConfigError(said("{part} holds no slot: a fault is planted at a part in a slot", part=info.part))
        return info.slot

    def check_condition(self, when: Condition | None) -> None:
        """Make sure that it can be known whether a condition holds.

        Raises:
            ConfigError: there is no such slot, port or number here.
        """
        if when is None:
            return
        if isinstance(when, NumberCondition):
            if when.source == LOAD:
                self.the_bus("load")
                return
            self._numbers.check(when.source)
            return
        if when.slot not in self._running.slot_names():
            hint = instead_of(when.slot, self._running.slot_names())
            raise ConfigError(said("the condition: there is no slot {slot}; {hint}", slot=when.slot, hint=hint))

    def obstacle(self, kind: FaultKind) -> str:
        """Why this robot can have no fault of a kind at any slot, a sentence; empty: it can."""
        if kind.acts is InjectionPoint.BUS and self._bus is None:
            return _no_bus(kind.name)
        if kind.name == "wrong-key" and self._running.master.blueprint.options.authentication == "open":
            return said(
                'this robot asks no part for a key: a wrong one would not be noticed; `authentication = "key"` in the '
                "blueprint changes that"
            )
        return ""

    def effect(self, spec: FaultSpec) -> Effect:
        """What the fault does here.

        Raises:
            ConfigError: it cannot be planted here; the text says why.
        """
        match spec.kind.acts:
            case InjectionPoint.SENSOR:
                return self._distorted(spec)
            case InjectionPoint.GUEST:
                return self._guest(spec)
            case InjectionPoint.BUS:
                return self._at_bus(spec)
            case _:
                pass
        match spec.kind.name:
            case "unplug":
                return self._cut(spec.at)
            case "master-frozen":
                return PacketFaultEffect(self._edge, "", FrozenLink())
            case "database-gone":
                registry, _ = self._running.database()
                return DatabaseUnavailable(registry)
        return PacketFaultEffect(self._edge, spec.at, _core(spec))

    def _cut(self, slot: str) -> Effect:
        if slot in self._parts.names:
            return UnpluggedPart(self._parts, slot)
        return PacketFaultEffect(self._edge, slot, Disturbance(Random(0), drop=1.0))

    def _distorted(self, spec: FaultSpec) -> Effect:
        unit = self._parts.simulated(spec.at) if spec.at in self._parts.names else None
        if unit is None:
            raise ConfigError(
                said(
                    "{at} is not simulated in the master's process: what its sensor says cannot be changed. "
                    "What a real part sends can be lost, late, doubled or overtaken",
                    at=spec.at,
                )
            )
        ports = [output.port for output in (unit.part_type.simulator.outputs if unit.part_type.simulator else ())]
        if not ports or (spec.port and spec.port not in ports):
            known = ", ".join(ports) or said("none")
            raise ConfigError(said("{at} has no sensor at that port; it publishes: {known}", at=spec.at, known=known))
        if spec.kind.name == "stuck":
            return DistortedReadings(self._parts, spec.at, StuckValue(spec.port))
        return DistortedReadings(self._parts, spec.at, DriftingValue(spec.port, spec.amount, unit.part_type))

    def _guest(self, spec: FaultSpec) -> Effect:
        holder = self._running.holder(spec.at)
        if holder is None or not holder.uid:
            raise ConfigError(
                said("slot {at} has no part with an identity now: there is nothing to imitate", at=spec.at)
            )
        library = self._running.library
        number = self._running.inventory.slots.number_of(spec.at)
        if library is None or library.find(number) is None:
            raise ConfigError(said("the library does not know {number}: it cannot be simulated", number=number))
        name = holder.local_name or holder.part
        if spec.kind.name == "duplicate-identity":
            unit = make_simulator(number, uid=holder.uid, local_name=name, library=library, random=Random(spec.seed))
            return UnexpectedPart(self._guests, unit)
        if spec.kind.name == "wrong-number":
            wrong = spec.number or self._wrong_number()
            uid = Random(f"wrong number {spec.seed}").randbytes(8)
            unit = make_simulator(wrong, uid=uid, local_name=f"{name}?", library=library, random=Random(spec.seed))
            return CombinedEffect(self._cut(spec.at), UnexpectedPart(self._guests, unit))
        if why := self.obstacle(spec.kind):
            raise ConfigError(why)
        unit = make_simulator(number, uid=holder.uid, local_name=name, library=library, random=Random(spec.seed))
        unit.part.key = WRONG_KEY
        return CombinedEffect(self._cut(spec.at), UnexpectedPart(self._guests, unit))

    def _wrong_number(self) -> str:
        """A number of the library that no slot takes."""
        library = self._running.library
        assert library is not None
        taken = {self._running.inventory.slots.number_of(name) for name in self._running.slot_names()}
        for part_type in library:
            if part_type.number not in taken and not taken & set(part_type.compatible_with) and part_type.simulator:
                return part_type.number
        raise ConfigError(said("every number of the library has a slot here: name one with --number"))

    def _at_bus(self, spec: FaultSpec) -> Effect:
        bus = self.the_bus(spec.kind.name)
        match spec.kind.name:
            case "bit-errors":
                return BitErrors(bus, spec.amount / 1e6, Random(spec.seed))
            case "babbling":
                return BabblingNode(bus, spec.amount / 100)
        if spec.at not in self._parts.names:
            raise ConfigError(
                said("{at} is not simulated in the master's process: its CAN controller cannot be broken", at=spec.at)
            )
        return BrokenSender(bus, spec.at)

    def the_bus(self, what: str) -> SimBusDriver:
        """The simulated bus.

        Raises:
            ConfigError: there is none; `what` needs it.
        """
        if self._bus is None:
            raise ConfigError(_no_bus(what))
        return self._bus


def _no_bus(what: str) -> str:
    return said(
        "{what} needs a CAN bus that is simulated in the master's process, as `msbot demo` has: a program cannot break "
        "the frames of a real bus",
        what=what,
    )


def _core(spec: FaultSpec) -> PacketTreatment:
    """What an edge fault does to packets."""
    random, share = Random(spec.seed), spec.amount / 100
    if spec.kind.name in (brought := KINDS.brought()):
        return ErrorTolerantTreatment(spec.kind.name, brought[spec.kind.name].treat, spec.amount, random)
    match spec.kind.name:
        case "late":
            return DelayedBurst(spec.amount)
        case "loss":
            return Disturbance(random, drop=share)
        case "delay":
            return Disturbance(random, delay=spec.amount / 1000, jitter=spec.jitter_ms / 1000)
        case "duplicates":
            return Disturbance(random, duplicate=share)
        case "reordering":
            return Disturbance(random, reorder=share, overtaken_s=OVERTAKEN_S)
        case _:
            return SlowReceiver(spec.amount)
