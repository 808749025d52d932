"""A drive (CiA 402): speed, angle and torque in, turns, position and load out, quick stop."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from msbot.part import Message
from msbot.part.messages.standard import Angle, Level, Speed
from msbot_bridges.bridge import DeviceOutput, ForeignDevice, Input
from msbot_bridges.canopen import objects
from msbot_bridges.canopen.canopen_device import CanopenDevice, NodeBus, SetUp, watch_each_other
from msbot_bridges.canopen.drive_states import POWERLESS, DriveState, SetPoints, controlword, state_of
from msbot_bridges.canopen.node_description import NodeDescription
from msbot_bridges.canopen.objects import Entry
from msbot_bridges.canopen.pdo_layout import distribute
from msbot_bridges.canopen.sdo_requests import SdoRefused, SdoRequests

REPORT_MS: Final = 100
REPORTS_FOR_AN_ORDER: Final = 5
"""So many reports of a drive later it gets the same orders again."""
STANDS_RPM: Final = 1.0
_TARGET_REACHED: Final = 1 << 10
"""In QUICK STOP ACTIVE this bit of the statusword says that the motor stands."""
QUICK_STOP: Final = "quick stop"
"""What STOP does, whatever a slot's safe values are."""
_PORTS: Final = {
    objects.PROFILE_VELOCITY: "speed",
    objects.PROFILE_POSITION: "angle",
    objects.PROFILE_TORQUE: "torque",
}
_TARGETS: Final = {
    objects.PROFILE_VELOCITY: objects.TARGET_VELOCITY,
    objects.PROFILE_POSITION: objects.TARGET_POSITION,
    objects.PROFILE_TORQUE: objects.TARGET_TORQUE,
}


class DriveDevice(CanopenDevice):
    """See `CanopenDevice`."""

    def __init__(self, description: NodeDescription, bus: NodeBus, news: Callable[[ForeignDevice], None]) -> None:
        super().__init__(description, bus, news)
        assert description.drive is not None
        facts = self._facts = description.drive
        self.outputs = tuple(
            output
            for output, is_there in (
                (DeviceOutput("turns", Speed), facts.has_velocity),
                (DeviceOutput("position", Angle), facts.has_position),
                (DeviceOutput("load", Level), facts.has_torque),
            )
            if is_there
        )
        self.inputs = tuple(_input(mode, facts.most_torque) for mode in facts.modes)
        self._mode = facts.modes[0]
        self._targets = dict[Entry, int]()
        self._set_points = SetPoints()
        self._wants_power = False
        self._rests = False
        """Nobody is in command: it has stopped, and waits for the next order."""
        self._rests_at = dict[int, Message]()
        """What the slot has it do then, by mode, where that is not to stop."""
        self._state: DriveState | None = None
        self._statusword = 0
        self._velocity: int | None = None
        self._sent = dict[Entry, int]()
        """Its orders as they were sent."""
        self._reports = 0
        """How often it has reported since then."""

    def configure(self, ask: SdoRequests) -> SetUp:
        """See `CanopenDevice`."""
        period = watch_each_other(ask)
        wanted = [objects.STATUSWORD]
        wanted += [objects.VELOCITY] if self._facts.has_velocity else []
        wanted += [objects.TORQUE] if self._facts.has_torque else []
        wanted += [objects.POSITION] if self._facts.has_position else []
        reports = [
            ask.map_pdo(number, entries, is_sent=True, event_ms=REPORT_MS)
            for number, entries in enumerate(distribute(wanted, 2), 1)
        ]
        orders = []
        for number, mode in enumerate(self._facts.modes, 1):
            entries = (objects.CONTROLWORD, objects.MODE, _TARGETS[mode])
            try:
                orders.append(ask.map_pdo(number, entries, is_sent=False))
            except SdoRefused:
                if len(self._facts.modes) > 1:
                    raise  # the mode has to change while it runs
                orders.append(ask.map_pdo(number, (objects.CONTROLWORD, _TARGETS[mode]), is_sent=False))
                ask.write(objects.MODE, mode)
        return SetUp(tuple(reports), tuple(orders), period)

    def end(self) -> None:
        """See `ForeignDevice`: nobody would stop it later, so quick stop comes whatever its slot says."""
        self._stop_quickly()
        super().end()

    def act(self, port: str, message: Message) -> None:
        """See `ForeignDevice`."""
        mode, target = self._target(port, message)
        entry = _TARGETS[mode]
        if mode == objects.PROFILE_POSITION and (self._targets.get(entry) != target or self._mode != mode):
            self._set_points.new()
        self._mode, self._targets[entry] = mode, target
        self._wants_power, self._rests = True, False
        self._drive()

    def safe_is(self, port: str, message: Message) -> None:
        """See `ForeignDevice`: at STOP comes quick stop, which ends every target."""

    def rests_at(self, port: str, message: Message) -> None:
        """See `ForeignDevice`: to stand is quick stop; the slot may say something else."""
        own = next(one for one in self.inputs if one.name == port)
        if message != own.safe:
            self._rests_at[self._target(port, message)[0]] = message

    def rest(self) -> None:
        """See `ForeignDevice`."""
        message = self._rests_at.get(self._mode)
        self._rests_at.clear()
        if message is None:
            self._stop_quickly()
        else:
            self.act(_PORTS[self._mode], message)

    def leave(self) -> None:
        """See `ForeignDevice`: quick stop, whatever its slot says."""
        self._rests_at.clear()
        super().leave()

    def _target(self, port: str, message: Message) -> tuple[int, int]:
        """The mode of operation for a message, and its target in the drive's units."""
        if isinstance(message, Speed):
            return objects.PROFILE_VELOCITY, round(message.rpm / self._facts.rpm)
        if isinstance(message, Level):
            return objects.PROFILE_TORQUE, round(message.percent / objects.THOUSANDTH)
        assert isinstance(message, Angle), port
        assert self._facts.degrees is not None
        return objects.PROFILE_POSITION, round(message.degrees / self._facts.degrees)

    def _stop_quickly(self) -> None:
        self._forget_orders()
        self._rests = True
        self._drive(urgent=True)

    def stop(self) -> None:
        """See `ForeignDevice`."""
        self._forget_orders()
        super().stop()

    def still_entries(self) -> Sequence[Entry]:
        """See `CanopenDevice`."""
        return [objects.STATUSWORD, objects.VELOCITY] if self._facts.has_velocity else [objects.STATUSWORD]

    def tell_still(self) -> None:
        """See `CanopenDevice`."""
        if self.is_operational:
            self._drive(urgent=True)
        else:
            self._bus.write(self, objects.CONTROLWORD, self._word(), urgent=True)

    @property
    def not_still(self) -> str:
        """See `CanopenDevice`."""
        return f"that its drive stands (it is in {self._state.value})" if self._state else "the state of its drive"

    @property
    def fault(self) -> str:
        """See `ForeignDevice`."""
        if found := super().fault:
            return found
        return f"node {self.node_id}: its drive is in the state FAULT" if self._state is DriveState.FAULT else ""

    def started(self) -> None:
        """See `CanopenDevice`."""
        self._drive()

    def told(self, values: Mapping[Entry, int], *, is_answer: bool = False) -> None:
        """See `CanopenDevice`."""
        if (velocity := values.get(objects.VELOCITY)) is not None:
            self._velocity = velocity
            self.report("turns", Speed(rpm=velocity * self._facts.rpm))
        if (position := values.get(objects.POSITION)) is not None and self._facts.degrees is not None:
            self.report("position", Angle(degrees=position * self._facts.degrees))
        if (torque := values.get(objects.TORQUE)) is not None:
            self.report("load", Level(percent=torque * objects.THOUSANDTH))
        if (statusword := values.get(objects.STATUSWORD)) is None:
            return
        had_fault = self._state is DriveState.FAULT
        self._statusword, self._state = statusword, state_of(statusword)
        if had_fault is not (self._state is DriveState.FAULT):
            self._news(self)
        if is_answer and self._stands():
            self.confirm_still()
        elif self.is_waiting_to_be_still and self._stands():
            self.ask_still()
        self._drive(again=False)

    def _stands(self) -> bool:
        if self._state in POWERLESS:
            return True
        if self._state is not DriveState.QUICK_STOP:
            return False
        if self._velocity is not None:
            return abs(self._velocity * self._facts.rpm) <= STANDS_RPM
        return bool(self._statusword & _TARGET_REACHED)

    def _word(self) -> int:
        state = self._state or DriveState.ENABLED  # until it has reported, the worst is assumed
        stops = self.is_stopping or self._rests
        word = controlword(state, wants_power=self._wants_power, is_stopping=stops)
        if state is DriveState.ENABLED and self._wants_power and self._mode == objects.PROFILE_POSITION:
            word |= self._set_points.bits(self._statusword)
        return word

    def _drive(self, *, urgent: bool = False, again: bool = True) -> None:
        """Send its orders.

        Args:
            urgent: before all other orders.
            again: also when they are those that it has; otherwise only now and then, because a frame may get lost.
        """
        if not self.is_operational:
            return
        target = _TARGETS[self._mode]
        values = {
            objects.CONTROLWORD: self._word(),
            objects.MODE: self._mode,
            target: self._targets.get(target, 0),
        }
        self._reports += 1
        if again or values != self._sent or self._reports >= REPORTS_FOR_AN_ORDER:
            self._sent, self._reports = values, 0
            self.order(values, target, urgent=urgent)

    def _forget_orders(self) -> None:
        self._wants_power = False
        self._targets.clear()
        self._set_points.forget()


def _input(mode: int, most_torque: float | None) -> Input:
    port = _PORTS[mode]
    if mode == objects.PROFILE_TORQUE:
        ranges = {} if most_torque is None else {"percent": (-most_torque, most_torque)}
        return Input(port, Level, safe=Level(percent=0), ranges=ranges, stops_by=QUICK_STOP)
    if mode == objects.PROFILE_VELOCITY:
        return Input(port, Speed, safe=Speed(rpm=0), stops_by=QUICK_STOP)
    return Input(port, Angle, stops_by=QUICK_STOP)
