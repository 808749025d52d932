"""The other side of layer setting services (LSS, CiA 305): a device that has, or waits for, a node id and a bit rate.

The library has no such side; its own master has found and configured this one in a test.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from msbot_bridges.canopen.lss import CONFIGURE_ID, FASTSCAN, IDENTIFIED, STORE, SWITCH_GLOBAL, LssAddress
from msbot_bridges.canopen.lss_bit_rates import ACTIVATE_TIMING, BIT_RATES, CONFIGURE_TIMING, SELECT, SELECTED

_ALL_BITS: Final = 0xFFFFFFFF
_ANYBODY: Final = 0x80
_TELL_ADDRESS, _TELL_ID = 0x5A, 0x5E
_NO_ID: Final = 0xFF


class LssSlave:
    """Answers the questions of a master. Pure.

    Args:
        address: who it is.
        bit_rates: those that it can have.
    """

    def __init__(self, address: LssAddress, bit_rates: Sequence[int] = BIT_RATES) -> None:
        self.node_id: int | None = None
        self.bit_rate: int | None = None
        """What it was told to have; None: nothing else than it has."""
        self.switches_after_ms: int | None = None
        """It was told to change to that after so long, and to be silent for as long again; None: it was not."""
        self.is_stored = False
        self.is_started = False
        """It has got a node id, and was told to start with it."""
        self._address, self._bit_rates = address, bit_rates
        self._is_configured = False
        """It is the one that is being configured."""
        self._place = 0
        self._selected = 0

    def received(self, data: bytes) -> bytes | None:
        """The answer to a question; None: there is none."""
        number = int.from_bytes(data[1:5], "little")
        match data[0]:
            case command if command == FASTSCAN:
                return self._scan(number, *data[5:8])
            case command if command == SWITCH_GLOBAL:
                self._is_configured = bool(data[1])
                self.is_started = not data[1] and self.node_id is not None
            case command if SELECT <= command < SELECT + 4:
                return self._select(command - SELECT, number)
            case command if not self._is_configured:
                return None
            case command if command == CONFIGURE_ID:
                is_right = 1 <= data[1] <= 127
                self.node_id = data[1] if is_right else self.node_id
                return _answer(command, 0 if is_right else 1)
            case command if command == CONFIGURE_TIMING:
                is_right = data[1] == 0 and data[2] < len(BIT_RATES) and BIT_RATES[data[2]] in self._bit_rates
                self.bit_rate = BIT_RATES[data[2]] if is_right else self.bit_rate
                return _answer(command, 0 if is_right else 1)
            case command if command == ACTIVATE_TIMING:
                self.switches_after_ms = int.from_bytes(data[1:3], "little")
                return None
            case command if command == STORE:
                self.is_stored = True
                return _answer(command, 0)
            case command if command == _TELL_ID:
                return _answer(command, self.node_id or _NO_ID)
            case command if _TELL_ADDRESS <= command < _TELL_ADDRESS + 4:
                return _answer(command, *self._address[command - _TELL_ADDRESS].to_bytes(4, "little"))
        return None

    def _scan(self, number: int, bit: int, place: int, following: int) -> bytes | None:
        if self.node_id is not None or self._is_configured:
            return None
        if bit == _ANYBODY:
            self._place = 0
            return _answer(IDENTIFIED)
        mask = _ALL_BITS << bit & _ALL_BITS
        if place != self._place or (self._address[place] ^ number) & mask:
            return None
        if bit == 0:
            self._place = following
            self._is_configured = following < place
        return _answer(IDENTIFIED)

    def _select(self, place: int, number: int) -> bytes | None:
        self._selected = self._selected + 1 if place == self._selected and self._address[place] == number else 0
        if self._selected < len(self._address):
            return None
        self._selected, self._is_configured = 0, True
        return _answer(SELECTED)


def _answer(*octets: int) -> bytes:
    return bytes(octets).ljust(8, b"\0")
