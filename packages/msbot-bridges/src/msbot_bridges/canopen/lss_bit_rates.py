"""Bit rates of devices: the master's side of LSS (CiA 305). Pure.

A device is selected by its LSS address, told which bit rate it is to have, and left; nothing happens yet. When all know
it, they are told together to change. Only after that, at the new rate, they are told to keep it, so that a device that
is lost on the way has its old rate again when it is switched off and on. The questions are generators, as in `lss`.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Final

from msbot_bridges.canopen.lss import STORE, SWITCH_GLOBAL, LssAddress, LssQuestion

CONFIGURE_TIMING, ACTIVATE_TIMING = 0x13, 0x15
SELECT, SELECTED = 0x40, 0x44
BIT_RATES: Final = (1_000_000, 800_000, 500_000, 250_000, 125_000, 100_000, 50_000, 20_000, 10_000)
"""By their place in the table of CiA 305."""
SWITCH_MS: Final = 500
"""Devices wait so long, change, and say nothing for as long again."""
_WAITING, _CONFIGURATION = 0, 1
_STORES_NOT: Final = 1

Asking = Generator[LssQuestion, bytes | None, str]
"""Its result is what is wrong, for people; empty: nothing."""


def set_rate(address: LssAddress, bit_rate: int) -> Asking:
    """Tell one device which bit rate it is to have when all change."""
    if why := (yield from _select(address)):
        return why
    answer = yield _question(CONFIGURE_TIMING, 0, BIT_RATES.index(bit_rate))
    yield _question(SWITCH_GLOBAL, _WAITING, is_answered=False)
    if answer is None or answer[0] != CONFIGURE_TIMING:
        return "does not answer when it is told its bit rate"
    return f"cannot have {bit_rate} bit/s" if answer[1] else ""


def is_there(address: LssAddress) -> Asking:
    """Whether one device answers."""
    why = yield from _select(address)
    yield _question(SWITCH_GLOBAL, _WAITING, is_answered=False)
    return why


def keep(address: LssAddress) -> Asking:
    """Have one device keep the bit rate that it has now."""
    if why := (yield from _select(address)):
        return why
    answer = yield _question(STORE)
    yield _question(SWITCH_GLOBAL, _WAITING, is_answered=False)
    if answer is None or answer[0] != STORE:
        return "does not answer when it is told to keep its bit rate"
    if answer[1] == _STORES_NOT:
        return "cannot keep its bit rate: it has the old one again when it is switched off and on"
    return f"does not keep its bit rate (error {answer[1]})" if answer[1] else ""


def change() -> Asking:
    """Have all devices change to the bit rate that each was told."""
    yield _question(SWITCH_GLOBAL, _CONFIGURATION, is_answered=False)
    yield _question(ACTIVATE_TIMING, *SWITCH_MS.to_bytes(2, "little"), is_answered=False)
    return ""


def all_are_waiting() -> Asking:
    """End the configuration of all devices."""
    yield _question(SWITCH_GLOBAL, _WAITING, is_answered=False)
    return ""


def _select(address: LssAddress) -> Asking:
    yield _question(SWITCH_GLOBAL, _WAITING, is_answered=False)
    answer: bytes | None = None
    for place, number in enumerate(address):
        is_last = place == len(address) - 1
        answer = yield _question(SELECT + place, *number.to_bytes(4, "little"), is_answered=is_last)
    return "" if answer is not None and answer[0] == SELECTED else "does not answer to LSS"


def _question(*octets: int, is_answered: bool = True) -> LssQuestion:
    return LssQuestion(bytes(octets).ljust(8, b"\0"), is_answered)
