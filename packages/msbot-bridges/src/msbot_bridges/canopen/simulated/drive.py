"""A simulated drive (CiA 402): state machine, ramps, profile velocity, position and torque, quick stop."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from canopen.objectdictionary import ObjectDictionary

from msbot_bridges.canopen import objects
from msbot_bridges.canopen.drive_states import DriveState
from msbot_bridges.canopen.objects import Entry
from msbot_bridges.canopen.simulated.local_device import LocalDevice, add, add_pdos, add_text

INCREMENTS: Final = 4096
"""For one turn."""
_STATUS: Final = {
    DriveState.SWITCH_ON_DISABLED: 0x40,
    DriveState.READY: 0x21,
    DriveState.SWITCHED_ON: 0x23,
    DriveState.ENABLED: 0x27,
    DriveState.QUICK_STOP: 0x07,
    DriveState.FAULT: 0x08,
}
_TARGETS: Final = (objects.TARGET_POSITION, objects.TARGET_VELOCITY, objects.TARGET_TORQUE)
_RPM_BY_TORQUE: Final = 1.0
"""It turns against a load that grows with its speed: turns a minute for a thousandth of its rated torque."""
_REACHED, _ACKNOWLEDGED = 1 << 10, 1 << 12
_PROFILE_VELOCITY, _ACCELERATION, _QUICK_STOP_DECELERATION = (Entry(one, 0, 32) for one in (0x6081, 0x6083, 0x6085))
_NEARLY: Final = 2.0
"""Increments within which a position counts as reached."""


def dictionary(node_id: int, serial: int, *, has_torque: bool = False) -> ObjectDictionary:
    """The objects of the drive."""
    made = ObjectDictionary()
    add(made, "Device type", objects.DEVICE_TYPE, 402 | 2 << 16, is_writable=False)
    add(made, "Error register", objects.ERROR_REGISTER, 0, is_writable=False)
    add_text(made, "Device name", objects.DEVICE_NAME, "SimDrive")
    add_text(made, "Software version", objects.SOFTWARE_VERSION, "1.0")
    add(made, "Consumer heartbeat", objects.CONSUMER_HEARTBEAT, 0)
    add(made, "Producer heartbeat", objects.PRODUCER_HEARTBEAT, 200)
    for name, entry, value in (
        ("Identity vendor", objects.VENDOR, 0x4D53),
        ("Identity product", objects.PRODUCT, 0x402),
        ("Identity revision", objects.REVISION, 0x10000),
        ("Identity serial", objects.SERIAL, serial),
    ):
        add(made, name, entry, value, is_writable=False)
    add_pdos(made, node_id, (1, 2), (1, 2, 3) if has_torque else (1, 2))
    if has_torque:
        for name, entry, value in (
            ("Target torque", objects.TARGET_TORQUE, 0),
            ("Motor rated torque", Entry(0x6076, 0, 32), 500),
            ("Torque actual value", objects.TORQUE, 0),
            ("Torque slope", Entry(0x6087, 0, 32), 1000),
        ):
            add(made, name, entry, value)
    for name, entry, value in (
        ("Controlword", objects.CONTROLWORD, 0),
        ("Statusword", objects.STATUSWORD, 0x40),
        ("Quick stop option code", Entry(0x605A, 0, 16, signed=True), 2),
        ("Modes of operation", objects.MODE, objects.PROFILE_VELOCITY),
        ("Position actual value", objects.POSITION, 0),
        ("Velocity actual value", objects.VELOCITY, 0),
        ("Max torque", Entry(0x6072, 0, 16), 1000),
        ("Target position", objects.TARGET_POSITION, 0),
        ("Profile velocity", _PROFILE_VELOCITY, 60),
        ("Profile acceleration", _ACCELERATION, 600),
        ("Profile deceleration", Entry(0x6084, 0, 32), 600),
        ("Quick stop deceleration", _QUICK_STOP_DECELERATION, 3000),
        ("Encoder increments", objects.ENCODER_INCREMENTS, INCREMENTS),
        ("Encoder turns", objects.ENCODER_TURNS, 1),
        ("SI unit velocity", objects.VELOCITY_UNIT, 0x00B44700),
        ("Target velocity", objects.TARGET_VELOCITY, 0),
        ("Supported drive modes", objects.MODES, 1 << 2 | 1 << 0 | (1 << 3 if has_torque else 0)),
    ):
        add(made, name, entry, value)
    return made


class SimulatedDrive(LocalDevice):
    """The drive.

    Args:
        address: `INTERFACE:CHANNEL[?bitrate=N]` of python-can.
        node_id: where it is on its bus.
        serial: tells it from others of its kind; its node id unless given.
        has_torque: it has the mode profile torque, too.
    """

    def __init__(self, address: str, node_id: int = 5, serial: int | None = None, *, has_torque: bool = False) -> None:
        number = node_id if serial is None else serial
        super().__init__(address, node_id, dictionary(node_id, number, has_torque=has_torque))
        self._has_torque = has_torque
        self.state = DriveState.SWITCH_ON_DISABLED
        self.rpm = 0.0
        self.turns = 0.0
        """Where its shaft is."""
        self.is_stuck = False
        """It does not slow down: for tests."""
        self._target: float | None = None
        """In turns."""
        self._is_raised = False

    def fail(self, code: int, register: int) -> None:
        """Have a fault, and say so."""
        self.state = DriveState.FAULT
        self.put(objects.ERROR_REGISTER, register)
        self.node.emcy.send(code, register)

    def received(self, values: Mapping[tuple[int, int], int]) -> None:
        """See `LocalDevice`."""
        for entry in (objects.MODE, *_TARGETS, objects.CONTROLWORD):
            if (value := values.get((entry.index, entry.subindex))) is not None:
                self.put(entry, value)
        self._obey()

    def step(self, seconds: float) -> None:
        """See `LocalDevice`."""
        self._obey()
        wanted, ramp = 0.0, float(self.get(_ACCELERATION))
        mode = self.get(objects.MODE)
        is_reached = False
        if self.state is DriveState.ENABLED and mode == objects.PROFILE_VELOCITY:
            wanted = float(self.get(objects.TARGET_VELOCITY))
            is_reached = abs(self.rpm - wanted) < 1
        elif self.state is DriveState.ENABLED and mode == objects.PROFILE_TORQUE and self._has_torque:
            most_torque = self.get(objects.MAX_TORQUE)
            torque = max(-most_torque, min(most_torque, self.get(objects.TARGET_TORQUE)))
            wanted, is_reached = torque * _RPM_BY_TORQUE, True
            self.put(objects.TORQUE, torque)
        elif self.state is DriveState.ENABLED and self._target is not None:
            wanted, is_reached = self._towards(self._target)
            ramp *= 10
        elif self.state is DriveState.QUICK_STOP:
            ramp = float(self.get(_QUICK_STOP_DECELERATION))
        if not self.is_stuck:
            most = max(1.0, ramp) * seconds
            self.rpm += max(-most, min(most, wanted - self.rpm))
        if self.state is DriveState.QUICK_STOP and abs(self.rpm) < 1:
            self.rpm, self.state = 0.0, DriveState.SWITCH_ON_DISABLED  # option code 2
        self.turns += self.rpm / 60 * seconds
        word = _STATUS[self.state] | (_REACHED if is_reached else 0) | (_ACKNOWLEDGED if self._is_raised else 0)
        self.put(objects.STATUSWORD, word)
        if self._has_torque and self.state is not DriveState.ENABLED:
            self.put(objects.TORQUE, 0)
        self.put(objects.VELOCITY, round(self.rpm))
        self.put(objects.POSITION, round(self.turns * INCREMENTS))

    def _towards(self, target: float) -> tuple[float, bool]:
        """The speed that brings it to a position, and whether it is there."""
        away = target - self.turns
        if abs(away) * INCREMENTS <= _NEARLY:
            return 0.0, True
        most = float(self.get(_PROFILE_VELOCITY))
        return max(-most, min(most, away * 60 * 4)), False

    def _obey(self) -> None:
        """Change the state as the controlword says."""
        word = self.get(objects.CONTROLWORD)
        self.state = _next_state(self.state, word)
        rises = bool(word & 0x10) and not self._is_raised
        if self.state is DriveState.ENABLED and self.get(objects.MODE) == objects.PROFILE_POSITION and rises:
            self._target = self.get(objects.TARGET_POSITION) / INCREMENTS
        self._is_raised = bool(word & 0x10) and self.state is DriveState.ENABLED
        if self.state is not DriveState.ENABLED:
            self._target = None


def _next_state(state: DriveState, word: int) -> DriveState:
    if state is DriveState.FAULT:
        return DriveState.SWITCH_ON_DISABLED if word & 0x80 else state
    if not word & 0x02:
        return DriveState.SWITCH_ON_DISABLED  # disable voltage
    if not word & 0x04:
        return (
            DriveState.QUICK_STOP
            if state in (DriveState.ENABLED, DriveState.QUICK_STOP)
            else (DriveState.SWITCH_ON_DISABLED)
        )
    match word & 0x0F, state:
        case 0x06, DriveState.SWITCH_ON_DISABLED | DriveState.SWITCHED_ON | DriveState.ENABLED:
            return DriveState.READY
        case 0x07, DriveState.READY | DriveState.ENABLED:
            return DriveState.SWITCHED_ON
        case 0x0F, DriveState.READY | DriveState.SWITCHED_ON:
            return DriveState.ENABLED
    return state
