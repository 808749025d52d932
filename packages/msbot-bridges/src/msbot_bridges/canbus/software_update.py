"""New software for a node: how far a node is with an image. Pure.

The bridge tells the node the name of an image; the node reads it piece by piece (`uavcan.protocol.file.Read`), mostly
from its boot loader, and starts again. It is done when the node runs again, and says which software it has.
"""

from __future__ import annotations

from typing import Final

from msbot_xrce.lazy import dataclass

PIECE: Final = 256
"""Octets of an answer; a shorter one says that the image ends."""
QUIET_S: Final = 30.0
"""A node that has read nothing for so long has given up: erasing its memory takes some seconds."""
MOST_S: Final = 900.0
_REFUSALS: Final = {1: "it cannot take it in the state that it is in", 2: "it takes another one"}


@dataclass(frozen=True, slots=True)
class SoftwareVersion:
    """What a node says of its software."""

    major: int
    minor: int
    commit: int = 0
    crc: int = 0

    def __str__(self) -> str:
        """For people."""
        return f"{self.major}.{self.minor}" + (f" ({self.commit:08x})" if self.commit else "")


class SoftwareUpdate:
    """One node that takes an image.

    Args:
        where: the node, for people: `node 42`.
        unique: its unique id; a boot loader may have another node id.
        name: the image.
        octets: what it is.
        before: the software that the node has.
        now: in seconds.
    """

    def __init__(
        self, where: str, unique: bytes, name: str, octets: bytes, *, before: SoftwareVersion, now: float
    ) -> None:
        self.where, self.unique, self.name = where, unique, name
        self.outcome = ""
        """How it has ended, as a sentence; empty: it has not."""
        self._octets, self._before = octets, before
        self._began_at = self._moved_at = now
        self._read = 0
        self._has_end = False
        self._is_accepted = False

    @property
    def octets(self) -> int:
        """How many the image has."""
        return len(self._octets)

    @property
    def percent(self) -> int:
        """How much of the image the node has read."""
        return 100 * self._read // len(self._octets)

    @property
    def state(self) -> str:
        """What the node does, as a sentence."""
        return f"{self.where} takes new software ({self.name})"

    def answered(self, error: int | None, words: str, now: float) -> None:
        """The node has answered that it takes the image, or not; None: it has not answered."""
        self._moved_at = now
        if error is None:
            self._end(f"{self.where} has not answered that it takes {self.name}")
        elif error:
            why = words or _REFUSALS.get(error, f"error {error}")
            self._end(f"{self.where} refuses {self.name}: {why}")
        else:
            self._is_accepted = True

    def read(self, offset: int, now: float) -> bytes:
        """The node asks for the octets from here on."""
        piece = self._octets[offset : offset + PIECE]
        self._is_accepted, self._moved_at = True, now
        self._read = max(self._read, offset + len(piece))
        self._has_end |= len(piece) < PIECE
        return piece

    def reports(self, *, is_ill: bool) -> None:
        """Its boot loader says how it is.

        Args:
            is_ill: its health is ERROR or CRITICAL.
        """
        if is_ill and self._has_end:
            self._end(f"{self.where} has read {self.name}, and does not take it: its boot loader reports an error")

    def runs(self, version: SoftwareVersion) -> None:
        """The node has started again, is OPERATIONAL, and has said which software it has."""
        if not self._has_end:
            self._end(
                f"{self.where} has started again after {self.percent} % of {self.name}: it runs software {version}"
            )
        elif version == self._before:
            self._end(
                f"{self.where} has read {self.name}, and still runs software {version}: it has not taken it, or it is "
                "the same"
            )
        else:
            self._end(f"{self.where} runs software {version} from {self.name}; it ran {self._before}")

    def look(self, now: float) -> None:
        """End it when it takes too long."""
        if now - self._moved_at > QUIET_S:
            what = "nothing more" if self._read else "nothing"
            self._end(f"{self.where} has read {what} of {self.name} for {QUIET_S:g} s, at {self.percent} %")
        elif now - self._began_at > MOST_S:
            self._end(f"{self.where} is not done with {self.name} after {MOST_S:g} s, at {self.percent} %")

    def _end(self, words: str) -> None:
        self.outcome = self.outcome or words
