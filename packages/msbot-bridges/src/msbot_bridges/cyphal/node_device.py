"""A Cyphal node as a part: ports by the registers of its subjects, its STOP confirmed by what it publishes.

STOP gives each input its safe value, and takes away the readiness of an actuator that has a readiness port: it is told
STANDBY, in which it applies no force. What confirms that is its own report: the feedback that it is not ENGAGED;
without such a feedback, a report of the same quantity with the safe value. A node that publishes neither cannot
confirm it.
"""

from __future__ import annotations

from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from typing import Any, Final, Protocol

from msbot.part import Message
from msbot_bridges.bridge import DeviceIdentity, DeviceOutput, ForeignDevice, Input, Report, Value
from msbot_bridges.canbus.image_folder import ImageFolder
from msbot_bridges.canbus.updatable_node import UpdatableNode
from msbot_bridges.cyphal.aspect import ENGAGED, FEEDBACK, READINESS, STANDBY, Aspect, Builtin
from msbot_bridges.cyphal.node_registers import NodePorts, RegisterSetting, SubjectPort, named_aspects
from msbot_xrce.lazy import dataclass

NOMINAL, WARNING = 0, 3
OPERATIONAL: Final = 0
UPDATING: Final = 3
_MODES: Final = {1: "is starting", 2: "is in maintenance", UPDATING: "is updating its software"}


class SubjectBus(Protocol):
    """What a device uses of its bus; returns at once."""

    def take_in(self, device: CyphalNode) -> None:
        """Give subjects to ports that have none, then listen to the others."""

    def listen(self, device: CyphalNode) -> None:
        """Listen to it, as far as its ports have subjects."""

    def leave(self, device: CyphalNode) -> None:
        """Listen to it no longer."""

    def publish(
        self, device: CyphalNode, port: SubjectPort, fields: Builtin, *, urgent: bool, again: bool = False
    ) -> None:
        """Send a message to one of its ports.

        Args:
            device: whose port it is.
            port: the port.
            fields: of the message; of a vector the one place.
            urgent: before all other orders.
            again: it was told so before; what several have in common is repeated once.
        """

    def write(self, device: CyphalNode, setting: RegisterSetting, value: Value) -> None:
        """Write a register."""

    def restart(self, node_id: int) -> None:
        """Have it restart."""

    def update(self, device: CyphalNode, image: str) -> None:
        """Give it new software, by the name of its image."""

    def identify(self, node_id: int) -> None:
        """Have it show itself."""

    def news(self, device: ForeignDevice) -> None:
        """It has reported something."""


@dataclass(frozen=True, slots=True)
class _Driven:
    """An input of the part."""

    port: SubjectPort
    aspect: Aspect


class CyphalNode(UpdatableNode):
    """One node.

    Args:
        identity: from its GetInfo.
        node_id: where it is.
        ports: what its registers say.
        settings: its other registers.
        bus: the way to it.
        images: from which it can get new software; None: from none.
        remark: how it got the software that it has.
    """

    def __init__(
        self,
        identity: DeviceIdentity,
        node_id: int,
        ports: NodePorts,
        settings: Sequence[RegisterSetting],
        bus: SubjectBus,
        *,
        images: ImageFolder | None = None,
        remark: str = "",
    ) -> None:
        super().__init__(identity, node_id, images, remark)
        self.ports, self._bus = ports, bus
        taken = {one.name for one in self.services}
        self._driven = {
            name: _Driven(port, aspect)
            for port, aspects in named_aspects(ports.subscribed, taken).items()
            for name, aspect in aspects.items()
            if aspect.write is not None
        }
        heard = named_aspects(ports.published, {*taken, *self._driven}, "_state")
        self._heard = {
            port: told
            for port, aspects in heard.items()
            if (told := {name: aspect for name, aspect in aspects.items() if aspect.read is not None})
        }
        self.readiness = next((one for one in ports.subscribed if one.type_name == READINESS), None)
        self.outputs = tuple(
            DeviceOutput(name, one.message) for told in self._heard.values() for name, one in told.items()
        )
        stops_by = "" if self.readiness is None else "STANDBY"
        self.inputs = tuple(
            Input(name, one.aspect.message, safe=one.aspect.safe, stops_by=stops_by)
            for name, one in self._driven.items()
        )
        self._registers = {one.declared.name: one for one in settings}
        self.settings = tuple(one.declared for one in settings)
        self._has_feedback = any(one.type_name == FEEDBACK for one in self._heard)
        self._last: dict[SubjectPort, Builtin] = {}
        """What each of its ports was told last; repeated, because actuators stop by themselves when nobody speaks."""
        self._told: dict[SubjectPort, str] = {}
        """The input by which each port was driven last: that of an angle, or of a speed."""
        self._safe: dict[str, Message] = {}
        """The safe values that the robot has said for inputs, with this STOP or when it left them."""
        self._is_in = self.is_stopping = False
        self._unconfirmed = frozenset[str]()
        self.stop_number = 0
        """Which STOP holds, or held last."""
        self._report: Report | None = None
        self._health, self._mode = NOMINAL, OPERATIONAL
        self._trouble = ""

    @property
    def left_out(self) -> list[str]:
        """Ports whose data type is unknown here, and that are no part's ports."""
        known = (*self._heard, *(one.port for one in self._driven.values()), self.readiness)
        return [
            f"{one.name} ({one.type_name or 'no type'}"
            + (", and no one register says its place in it)" if one.places and one.place is None else ")")
            for one in (*self.ports.published, *self.ports.subscribed)
            if one not in known
        ]

    @property
    def used(self) -> list[SubjectPort]:
        """Its ports that the part has."""
        driven = dict.fromkeys(one.port for one in self._driven.values())
        return [*self._heard, *driven, *([self.readiness] if self.readiness is not None and driven else [])]

    # The contract

    def begin(self, report: Report) -> None:
        """See `ForeignDevice`."""
        self._report, self._is_in = report, True
        self._bus.take_in(self)
        self._be_ready(urgent=False)

    def end(self) -> None:
        """See `ForeignDevice`."""
        self._be_ready(STANDBY, urgent=True)
        self._report, self._is_in, self.is_stopping = None, False, False
        self._last.clear()
        self._bus.leave(self)
        self.take_update()

    def act(self, port: str, message: Message) -> None:
        """See `ForeignDevice`."""
        if not self.is_stopping:
            self._safe.pop(port, None)
            self._tell(port, message, urgent=False)

    def rests_at(self, port: str, message: Message) -> None:
        """See `ForeignDevice`."""
        self.act(port, message)
        self._safe[port] = message

    def rest(self) -> None:
        """See `ForeignDevice`; each port has got its safe value."""

    def leave(self) -> None:
        """See `ForeignDevice`: as at STOP, it reports that it is safe."""
        self._bus.listen(self)
        self.stop()

    def set(self, name: str, value: Value) -> None:
        """See `ForeignDevice`."""
        self._bus.write(self, self._registers[name], value)

    def safe_is(self, port: str, message: Message) -> None:
        """See `ForeignDevice`: `stop` sends it, and waits for it."""
        self._safe[port] = message
        self._told.setdefault(self._driven[port].port, port)

    def stop(self) -> None:
        """See `ForeignDevice`."""
        if not self.is_stopping:
            self.is_stopping = True
            self.stop_number += 1
            self._unconfirmed = frozenset({FEEDBACK}) if self._is_disengaged_by_stop else self._last_driven()
        self._be_ready(STANDBY, urgent=True)
        for name in self._last_driven():
            self._tell(name, self._safe_of(name), urgent=True)

    def go(self) -> None:
        """See `ForeignDevice`."""
        self.is_stopping = False
        self._safe.clear()
        self._last.clear()
        if self._is_in:
            self._be_ready(urgent=False)

    def changed(self) -> None:
        """See `UpdatableNode`."""
        self._bus.news(self)

    def tell_restart(self) -> None:
        """See `UpdatableNode`."""
        self._bus.restart(self.node_id)

    def tell_update(self, image: str) -> None:
        """See `UpdatableNode`."""
        self._bus.update(self, image)

    @property
    def not_stopped(self) -> str:
        """See `ForeignDevice`."""
        if not self.is_stopping or not self._unconfirmed:
            return ""
        if FEEDBACK in self._unconfirmed:
            return f"node {self.node_id} has not reported that it is disengaged"
        if silent := sorted(name for name in self._unconfirmed if not self._confirming(name)):
            return f"node {self.node_id} cannot report that {silent[0]} has its safe value"
        return f"node {self.node_id} has not reported that {min(self._unconfirmed)} has its safe value"

    @property
    def fault(self) -> str:
        """See `ForeignDevice`."""
        if self.update_words:
            return self.update_words
        if self._mode != OPERATIONAL:
            return f"node {self.node_id} {_MODES.get(self._mode, f'is in mode {self._mode}')}"
        if self._health == WARNING:
            return f"node {self.node_id} says that its health is WARNING"
        return self._trouble

    @property
    def is_updating(self) -> bool:
        """Whether it takes new software, as its heartbeat says."""
        return self._mode == UPDATING

    def identify(self) -> None:
        """See `ForeignDevice`."""
        self._bus.identify(self.node_id)

    # What its bus tells

    def heartbeat(self, health: int, mode: int) -> None:
        """Its heartbeat has come."""
        before = self.fault
        self._health, self._mode = health, mode
        if self.fault != before:
            self._bus.news(self)

    def failed(self, why: str) -> None:
        """It cannot be a part, as a sentence."""
        if why != self._trouble:
            self._trouble = why
            self._bus.news(self)

    def heard(self, port: SubjectPort, told: Any, *, is_old: bool = False) -> None:  # noqa: ANN401 - the library makes its classes when it runs
        """It has published a message; an old one may be of the time before STOP."""
        is_confirming = self.is_stopping and not is_old
        for name, aspect in self._heard[port].items():
            assert aspect.read is not None
            if (message := aspect.read(told)) is None:
                continue
            if self._report is not None:
                self._report(name, message)
            if is_confirming:
                self._confirm(aspect, message)
        if port.type_name == FEEDBACK and int(told.heartbeat.readiness.value) != ENGAGED and is_confirming:
            self._confirmed({FEEDBACK})

    def repeat(self) -> None:
        """Send again what its ports were told last."""
        for port, fields in self._last.items():
            self._bus.publish(self, port, fields, urgent=self.is_stopping, again=True)

    # Orders

    def _tell(self, name: str, message: Message, *, urgent: bool) -> None:
        driven = self._driven[name]
        assert driven.aspect.write is not None
        self._told[driven.port] = name
        self._last[driven.port] = driven.aspect.write(message)
        self._bus.publish(self, driven.port, self._last[driven.port], urgent=urgent)

    def _be_ready(self, readiness: int = ENGAGED, *, urgent: bool) -> None:
        if self.readiness is not None and self._driven:
            self._last[self.readiness] = {"value": STANDBY if self.is_stopping else readiness}
            self._bus.publish(self, self.readiness, self._last[self.readiness], urgent=urgent)

    def _safe_of(self, name: str) -> Message:
        if (safe := self._safe.get(name)) is not None:
            return safe
        safe = self._driven[name].aspect.safe
        assert safe is not None
        return safe

    def _last_driven(self) -> frozenset[str]:
        """For each port the input that drove it last; of one that was not driven, the last: a speed, not an angle."""
        return frozenset(({one.port: name for name, one in self._driven.items()} | self._told).values())

    # STOP

    @property
    def _is_disengaged_by_stop(self) -> bool:
        return bool(self._driven) and self.readiness is not None and self._has_feedback

    def _confirming(self, name: str) -> Sequence[Aspect]:
        """The reports of the same quantity; more than one could be of something else."""
        message = self._driven[name].aspect.message
        same = [one for told in self._heard.values() for one in told.values() if one.message is message]
        return same if len(same) == 1 else ()

    def _confirm(self, aspect: Aspect, message: Message) -> None:
        waiting = [name for name in self._unconfirmed - {FEEDBACK} if aspect in self._confirming(name)]
        self._confirmed({name for name in waiting if aspect.near(message, self._safe_of(name))})

    def _confirmed(self, names: AbstractSet[str]) -> None:
        if names & self._unconfirmed:
            self._unconfirmed -= names
            self._bus.news(self)
