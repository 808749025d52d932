"""Who else is on a bus where a bridge must be alone with its devices: noticed by what is heard there. Pure.

Two adapters on one wire have two addresses; so no check of addresses can see that a bridge shares the bus of the
robot's own parts, or that of another bridge of its kind.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from msbot_agent.link.can.protocol import CanIds, Frame, read_beacon

_IDS: Final = CanIds()
BEACON_ID: Final = _IDS.beacon
"""Of 11 bits; no device of another world has it by its standard."""


class Neighbours:
    """Says once what is wrong.

    Args:
        address: the bridge's bus.
        own: what the bridge itself is there, in words: `node 127`.
        say: takes the sentence.
    """

    def __init__(self, address: str, own: str, say: Callable[[str], None]) -> None:
        self._address, self._own, self._say = address, own, say
        self._told = set[str]()

    def standard(self, can_id: int, data: bytes) -> None:
        """A frame with an 11-bit identifier was heard."""
        if can_id == BEACON_ID and read_beacon(Frame(can_id, data), _IDS) is not None:
            self._tell(
                f"{self._address}: parts of MsBOT are on this bus, too, perhaps by another adapter; they and these "
                "devices disturb each other: use a bus for each"
            )

    def own(self) -> None:
        """A frame was heard that only this bridge may send: a controller does not hear its own."""
        self._tell(
            f"{self._address}: somebody else on this bus is {self._own}, perhaps another bridge by another adapter; "
            "one finds all devices: end the other"
        )

    def gives_ids(self, node_id: int) -> None:
        """Another node gives node ids: a device could get two."""
        self._tell(f"{self._address}: node {node_id} gives node ids, too: let only one do that")

    def no_ids(self) -> None:
        """A node has asked for an id, and there is none."""
        self._tell(f"{self._address}: a node asks for a node id, and all are in use")

    def _tell(self, words: str) -> None:
        if words not in self._told:
            self._told.add(words)
            self._say(words)
