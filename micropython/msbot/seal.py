"""Sealed samples: imported by parts that join a robot with sealing (docs/explain/security.md)."""

import hashlib
import struct

from .running import once


class Seals:
    """A part's seals: `_proved` since its last proof, `_present` since the first reply that one opened."""

    def __init__(self):
        self._present = self._proved = None
        self._insists = False  # a part that was in a robot with seals joins none without

    def prove(self, *claimed):
        """The proof (`keys.prove_sealed`); its secret counts from the first reply that it opens."""
        proof, pads = once("keys").prove_sealed(*claimed)
        self._proved = _Seal(*pads)
        return proof

    def session_lost(self):
        """Forget what was agreed in the session."""
        self._present = self._proved = None

    def open_reply(self, octets):
        """The inventory's message without its seal; None: it is rejected."""
        size = len(octets)
        if size == 17 or (self._present is None and self._may_be_unsealed(size, octets)):
            return octets
        channel = 1 if size > 22 else 0
        for seal in (self._proved, self._present):
            opened = seal and seal.open(channel, octets)
            if opened is not None:
                self._present, self._insists = seal, True
                if seal is self._proved:
                    self._proved = None
                return opened
        return None

    def _may_be_unsealed(self, size, octets):
        if size == 16 and not self._insists:
            self._proved = None  # the robot has none, whoever claimed otherwise before
        return (size == 12 and octets[:4] == b"\0\0\0\0") or (self._proved is None and not self._insists)

    def open(self, channel, octets):
        """A sample without its seal; None: it is rejected."""
        if self._present is None:
            return octets
        opened = self._proved and self._proved.open(channel, octets)
        return self._present.open(channel, octets) if opened is None else opened

    def seal(self, channel, octets):
        """A sample with its seal."""
        return octets if self._present is None else self._present.seal(channel, octets)

    def seal_request(self, octets):
        """A request to the inventory, sealed unless it is a claim or a proof."""
        size = len(octets)
        return self.seal(1 if size == 8 or size > 535 else 0, octets) if size <= 17 or size > 535 else octets


class _Seal:
    def __init__(self, up, down):
        self._up = up
        self._down = down
        self._sent = {}
        self._received = {}

    def seal(self, channel, octets):
        count = self._sent[channel] = min(self._sent.get(channel, 0) + 1, 0xFFFFFFFF)
        counter = struct.pack("<I", count)
        return octets + counter + _tag(self._up, channel, counter, octets)

    def open(self, channel, octets):
        size = len(octets) - 10
        if size < 0:
            return None
        sample, counter = octets[:size], octets[size : size + 4]
        differs = 0
        for ours, theirs in zip(_tag(self._down, channel, counter, sample), octets[size + 4 :]):
            differs |= ours ^ theirs
        count = struct.unpack("<I", counter)[0]
        if differs or count <= self._received.get(channel, 0):
            return None
        self._received[channel] = count
        return sample


def _tag(pads, channel, counter, octets):
    inner = hashlib.sha256(pads[0] + struct.pack(">H", channel) + counter + octets).digest()
    return hashlib.sha256(pads[1] + inner).digest()[:6]
