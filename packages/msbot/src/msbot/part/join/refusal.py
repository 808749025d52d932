"""Why a claim got no lease: the reason codes of plug-and-play, and their words."""

from __future__ import annotations

from enum import IntEnum


class Refusal(IntEnum):
    """Why a claim got no lease; the numbers are the reason codes on the wire."""

    UNKNOWN_PART = 1
    BLOCKED = 2
    DUPLICATE = 3
    NO_SLOT = 4
    WRONG_ROBOT = 5
    BAD_CLAIM = 6
    NOT_READY = 7
    WRONG_KEY = 8
    KEY_NEEDED = 9
    NO_KEY = 10
    REPLAYED = 11

    @property
    def describe(self) -> str:
        """The reason in plain words, without naming the part; the same at the part and at the master."""
        return _REFUSALS[self]


DESCRIBE_IT = 'with Part(..., describes="what it is") somebody can adopt it'
"""What a part that the robot does not know says to its programmer, if it does not describe itself."""
IS_TOLD = (
    "the robot does not know this part number, and is told what the part is: it waits until somebody adopts it, on the "
    "page Arrivals or with `msbot adopt`"
)
"""What it says otherwise."""
STANDBY = "standby"
"""What the master calls a part that was refused because no slot is free: it waits, and takes over when one is."""


def displayed_state(state: str, reason: str) -> str:
    """How a part calls its state when it tells people: refused with that reason, it may be a spare that waits."""
    return STANDBY if state == "refused" and reason == Refusal.NO_SLOT.describe else state


def refusal_hint(reason: str, part: str, *, describes: bool = False) -> str:
    """What a person at the part can do about a refusal, to be written behind the reason; empty: nothing at the part."""
    if reason == Refusal.UNKNOWN_PART.describe and not describes:
        return f"; {DESCRIBE_IT}"
    if reason == Refusal.DUPLICATE.describe:
        return "; if this program runs already on this computer, end that one, or give this one a UID: --uid HEX"
    return f"; `msbot why {part}` says which" if reason == Refusal.NO_SLOT.describe else ""


_REFUSALS = {
    Refusal.UNKNOWN_PART: "this part number is not in the library",
    Refusal.BLOCKED: "this part is blocked",
    Refusal.DUPLICATE: "another part with the same UID is active",
    Refusal.NO_SLOT: "every fitting slot is taken, or it is not clear which one is meant",
    Refusal.WRONG_ROBOT: "this robot has no slot for this part number",
    Refusal.BAD_CLAIM: "the claim makes no sense",
    Refusal.NOT_READY: "the inventory cannot read its registry",
    Refusal.WRONG_KEY: "the part's key is not the one on file for its UID",
    Refusal.KEY_NEEDED: "this robot asks for keys, and the part proves none",
    Refusal.NO_KEY: "this robot asks for keys, and has none for this part",
    Refusal.REPLAYED: "an old proof was shown again, or one that nobody asked for",
}
