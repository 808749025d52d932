"""Says what each frame of a CAN bus means, in sentences for everybody and in the words of the protocol.

For the page and for `msbot bus`, which listen to the same bus. Pure; never raises, whatever is on the bus.
"""

from __future__ import annotations

from collections.abc import Hashable

from msbot.pnp.explain_samples import Overhearer, PacketWords
from msbot.pnp.packet_words import piece_sentence
from msbot_agent.link.can.protocol import DOWN, UP, CanDecoder, CanIds, Frame, LegacyDecoder, frame_sentence, node_of
from msbot_agent.text.sentence import Sentence
from msbot_xrce import decompress, is_whole
from msbot_xrce.common.lazy_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class FrameWords:
    """What a frame says."""

    plain: tuple[str, ...]
    """The values in it, as sentences (`knob says level 49.9 %`): of a frame that completes a sample of a known part."""
    about: tuple[str, ...]
    """What a frame without such values is for, in a sentence: `knob says that it is alive`."""
    protocol: tuple[str, ...]
    """In the words of the protocol: the first line about the frame, the others about the packet it completes."""


_NOTHING = PacketWords((), (), ())


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
        self._ids, self._is_legacy = ids or CanIds(), legacy
        self._heard = _NOTHING
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
        self._heard = _NOTHING
        protocol = tuple(self._decoder.decode(frame, at))
        heard = self._heard
        return FrameWords(heard.plain, heard.about or (() if heard.plain else (self._about(frame),)), protocol)

    def _explain(self, packet: bytes, peer: Hashable, *, up: bool) -> list[str]:
        self._heard = self._overhearer.hear(packet, peer, up=up)
        return list(self._heard.protocol)

    def _about(self, frame: Frame) -> Sentence:
        """What a frame is for that completes no packet."""
        if self._is_legacy and not frame.extended and frame.can_id in (UP, DOWN):
            return piece_sentence(self._overhearer.part_at(0), up=frame.can_id == UP)
        node = None if self._is_legacy else node_of(frame, self._ids)
        if node is None:
            return frame_sentence(frame, self._ids)
        return piece_sentence(self._overhearer.part_at(node[0]), up=node[1])
