"""Node ids for devices that have none: layer setting services (LSS, CiA 305), the master's side. Pure.

Fastscan finds out the LSS address of one device among all that have no node id: it asks bit by bit, and all devices
whose address begins so answer with the same frame. The device that is left is configured, told to keep its node id, and
sent on its way. The questions are a generator: it yields what is asked, and is sent the answer, or None.
"""

from __future__ import annotations

from collections.abc import Collection, Generator
from typing import Final, NamedTuple

from msbot_xrce.errors import MsbotError

REQUEST_ID, ANSWER_ID = 0x7E5, 0x7E4
ANSWER_S: Final = 0.1
"""Longest wait for an answer; no answer is one, too."""
SETTLE_S: Final = 0.01
"""Pause after an answer, so that those of other devices to the same question have come."""
FIRST, LAST = 1, 126
ROOM: Final = 1000
"""Addresses that are remembered."""

SWITCH_GLOBAL, CONFIGURE_ID, STORE, FASTSCAN, IDENTIFIED = 0x04, 0x11, 0x17, 0x51, 0x4F
_ANYBODY: Final = 0x80
_WAITING: Final = 0


class LssAddress(NamedTuple):
    """Who a device is: the identity object (0x1018), unique in the world."""

    vendor: int
    product: int
    revision: int
    serial: int

    def __str__(self) -> str:
        """For people."""
        return f"vendor 0x{self.vendor:x}, product 0x{self.product:x}, serial number {self.serial}"


class Numbered(NamedTuple):
    """A device that has got a node id."""

    address: LssAddress
    node_id: int
    is_kept: bool
    """Whether it has stored it."""


class LssFailure(MsbotError):
    """A device has not done what it was told; the text says what."""


class LssQuestion(NamedTuple):
    """What is asked next."""

    data: bytes
    is_answered: bool = True
    """Devices answer this, or do not when it is not about them."""


Questions = Generator[LssQuestion, bytes | None, Numbered | None]


class LssNodeIds:
    """Which device has which node id; forgets devices that are gone when it needs their ids."""

    def __init__(self) -> None:
        self._known: dict[LssAddress, int] = {}

    def choose(self, address: LssAddress, taken: Collection[int]) -> int:
        """The id that a device had, or else the highest that is free.

        Args:
            address: the device.
            taken: ids of nodes that are on the bus.

        Raises:
            LssFailure: there is none.
        """
        had = self._known.pop(address, None)
        kept = set(self._known.values())
        if had is None or had in taken or had in kept:
            free = [one for one in range(LAST, FIRST - 1, -1) if one not in taken]
            if not free:
                raise LssFailure(f"there is no free node id for a device ({address})")
            had = next((one for one in free if one not in kept), None)
            if had is None:
                gone = next(one for one, node_id in self._known.items() if node_id not in taken)
                had = self._known.pop(gone)
        self._known[address] = had
        if len(self._known) > ROOM:
            del self._known[next(iter(self._known))]
        return had


def number_one(ids: LssNodeIds, taken: Collection[int]) -> Questions:
    """Find one device without a node id, and give it one; returns None when there is none.

    Raises:
        LssFailure: there is one, and it does not take an id.
    """
    if (yield _scan(0, _ANYBODY, 0, 0)) is None:
        return None
    parts = [0, 0, 0, 0]
    for place in range(4):
        for bit in range(31, -1, -1):
            if (yield _scan(parts[place], bit, place, place)) is None:
                parts[place] |= 1 << bit
        if (yield _scan(parts[place], 0, place, place + 1 & 3)) is None:
            yield _leave()
            raise LssFailure("a device without a node id was not found to its end; it is searched for again")
    address = LssAddress(*parts)
    try:
        node_id = ids.choose(address, taken)
        answer = yield LssQuestion(bytes([CONFIGURE_ID, node_id, 0, 0, 0, 0, 0, 0]))
        if answer is None or answer[0] != CONFIGURE_ID or answer[1]:
            why = "does not answer" if answer is None else f"error {answer[1]}"
            raise LssFailure(f"a device ({address}) does not take the node id {node_id}: {why}")
        answer = yield LssQuestion(bytes([STORE, 0, 0, 0, 0, 0, 0, 0]))
    finally:
        yield _leave()
    return Numbered(address, node_id, answer is not None and answer[0] == STORE and not answer[1])


def any_unnumbered() -> Generator[LssQuestion, bytes | None, str]:
    """Whether a device without a node id is there, in words; empty: none is."""
    return "is there" if (yield _scan(0, _ANYBODY, 0, 0)) is not None else ""


def _scan(number: int, bit: int, place: int, following: int) -> LssQuestion:
    return LssQuestion(bytes([FASTSCAN, *number.to_bytes(4, "little"), bit, place, following]))


def _leave() -> LssQuestion:
    """Those that are being configured are done: one with a node id starts with it."""
    return LssQuestion(bytes([SWITCH_GLOBAL, _WAITING, 0, 0, 0, 0, 0, 0]), is_answered=False)
