"""The state machine of a drive (CiA 402): which controlword brings it to where it should be. Pure.

A drive reports its state by the statusword, and takes orders by the controlword. It goes from SWITCH ON DISABLED over
READY TO SWITCH ON and SWITCHED ON to OPERATION ENABLED, one step for each controlword. A quick stop slows it down by a
ramp of its own.
"""

from __future__ import annotations

from enum import Enum
from typing import Final

SHUTDOWN, SWITCH_ON, ENABLE, DISABLE_VOLTAGE, QUICK_STOP = 0x06, 0x07, 0x0F, 0x00, 0x02
"""Controlwords."""
NEW_SET_POINT, CHANGE_NOW = 0x10, 0x20
"""Bits of the controlword in the mode profile position."""
_ACKNOWLEDGED = 1 << 12
"""Bit of the statusword: the drive has taken the set point."""


class DriveState(Enum):
    """What the statusword says."""

    NOT_READY = "NOT READY TO SWITCH ON"
    SWITCH_ON_DISABLED = "SWITCH ON DISABLED"
    READY = "READY TO SWITCH ON"
    SWITCHED_ON = "SWITCHED ON"
    ENABLED = "OPERATION ENABLED"
    QUICK_STOP = "QUICK STOP ACTIVE"
    FAULT_REACTION = "FAULT REACTION ACTIVE"
    FAULT = "FAULT"


_MASKS: Final = (
    (0x4F, 0x00, DriveState.NOT_READY),
    (0x4F, 0x40, DriveState.SWITCH_ON_DISABLED),
    (0x6F, 0x21, DriveState.READY),
    (0x6F, 0x23, DriveState.SWITCHED_ON),
    (0x6F, 0x27, DriveState.ENABLED),
    (0x6F, 0x07, DriveState.QUICK_STOP),
    (0x4F, 0x0F, DriveState.FAULT_REACTION),
    (0x4F, 0x08, DriveState.FAULT),
)
_TOWARDS_ENABLED: Final = {
    DriveState.NOT_READY: DISABLE_VOLTAGE,
    DriveState.SWITCH_ON_DISABLED: SHUTDOWN,
    DriveState.READY: SWITCH_ON,
    DriveState.SWITCHED_ON: ENABLE,
    DriveState.ENABLED: ENABLE,
    DriveState.QUICK_STOP: DISABLE_VOLTAGE,
    DriveState.FAULT_REACTION: DISABLE_VOLTAGE,
    DriveState.FAULT: DISABLE_VOLTAGE,  # a fault is reset by a person, not by a program
}
POWERLESS: Final = frozenset(
    {
        DriveState.NOT_READY,
        DriveState.SWITCH_ON_DISABLED,
        DriveState.READY,
        DriveState.SWITCHED_ON,
        DriveState.FAULT,
    }
)
"""States in which a drive does not move its motor."""


def state_of(statusword: int) -> DriveState:
    """The state that a statusword says."""
    return next((state for mask, bits, state in _MASKS if statusword & mask == bits), DriveState.NOT_READY)


class SetPoints:
    """Positions for the mode profile position: the drive takes one when a bit rises, and acknowledges it."""

    def __init__(self) -> None:
        self._newest = self._shown = self._taken = 0
        self._is_raised = False

    def new(self) -> None:
        """There is another target position."""
        self._newest += 1

    def forget(self) -> None:
        """None is to be taken any more."""
        self._shown = self._taken = self._newest
        self._is_raised = False

    def bits(self, statusword: int) -> int:
        """For the next controlword of a drive that is enabled and has reported this."""
        if statusword & _ACKNOWLEDGED:
            if self._is_raised:
                self._taken, self._is_raised = self._shown, False
            return CHANGE_NOW  # the bit falls, so that it can rise for the next
        if not self._is_raised and self._newest != self._taken:
            self._shown, self._is_raised = self._newest, True
        return CHANGE_NOW | NEW_SET_POINT if self._is_raised else CHANGE_NOW


def controlword(state: DriveState, *, wants_power: bool, is_stopping: bool) -> int:
    """What to send to a drive that is in a state.

    Args:
        state: what it has reported.
        wants_power: it is to move, or to hold its position.
        is_stopping: it is to stop as quickly as it can.
    """
    if is_stopping:
        return QUICK_STOP  # a drive without power stays so; one enabled since its report would roll on without voltage
    if not wants_power:
        return DISABLE_VOLTAGE if state in POWERLESS else SHUTDOWN
    return _TOWARDS_ENABLED[state]
