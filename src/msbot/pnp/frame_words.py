"""Says what each frame of a CAN bus means, in sentences for everybody and in the words of the protocol.

For the page and for `msbot bus`, which listen to the same bus. Pure; never raises, whatever is on the bus.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

from msbot.link.can.protocol import CanDecoder, CanIds, Frame, LegacyDecoder
from msbot.pnp.explain_samples import Overhearer
from msbot.xrce import decompress, is_whole


@dataclass(frozen=True, slots=True)
class FrameWords:
    """What a frame says."""

    plain: tuple[str, ...]
    """In sentences (`knob says level 49.9 %`), where there is one: a frame that completes a sample of a known part."""
    protocol: tuple[str, ...]
    """In the words of the protocol: the first line about the frame, the others about the packet it completes."""


class FrameListener:
    """Understands the frames of one bus, one after the other."""

    def __init__(
        self, overhearer: Overhearer | None = None, *, ids: CanIds | None = None, legacy: bool = False
    ) -> None:
        """Begin to listen.

        Args:
            overhearer: what is known of the robot; None: nothing but what every robot says.
            ids: identifier bases, when the bus is shared with other equipment.
            legacy: the bus is one of the thesis' firmware.
        """
        self._overhearer = overhearer or Overhearer()
        self._plain: list[str] = []
        self._decoder = (
            LegacyDecoder(self._explain, is_whole)
            if legacy
            else CanDecoder(self._explain, decompress=decompress, ids=ids)
        )

    @property
    def unknown(self) -> int:
        """Samples whose topic was agreed upon before anybody listened."""
        return self._overhearer.unknown

    def hear(self, frame: Frame, at: float) -> FrameWords:
        """What the next frame of the bus says; `at` is its time in seconds."""
        self._plain = []
        protocol = self._decoder.decode(frame, at)
        return FrameWords(tuple(self._plain), tuple(protocol))

    def _explain(self, packet: bytes, peer: Hashable, *, up: bool) -> list[str]:
        self._plain, words = self._overhearer.hear(packet, peer, up=up)
        return words
