"""Sealed samples: with `authentication = "key+data"` every sample itself proves who made it, and in which order. Pure.

Theory of operation. The proof with which a part joins (`keys.prove_sealed`) leaves both ends with a secret that never
travels and that no other session has. From it come two keys, one for each direction. Each sample is followed by a
counter and the first octets of an HMAC over channel, counter and sample. The receiver accepts a sample only when the
HMAC fits and the counter is higher than any before on that channel: so a sample that was changed, invented, recorded,
repeated, delayed behind a newer one, or moved to another port changes nothing but a counter of refused samples.

A channel is a sequence that keeps its order on the way: the object id of a data writer or reader, or one of the
inventory's two. What is lost leaves a gap in the counters, which is allowed.

=========  ======  ==================================================================
behind     octets
=========  ======  ==================================================================
counter    4       little-endian, from 1, of this channel and direction
tag        6       HMAC-SHA-256(key of the direction, channel (2 octets, big-endian) ·
                   counter · sample), the first 6 octets
=========  ======  ==================================================================

6 octets: a guess succeeds with one chance in 2^48 per packet, some 900 years at 10,000 packets a second.
"""

from __future__ import annotations

import hmac
from struct import Struct

COUNTER_OCTETS = 4
TAG_OCTETS = 6
SEAL_OCTETS = COUNTER_OCTETS + TAG_OCTETS
"""What a seal adds to a sample."""
LAST_COUNTER = 0xFFFFFFFF

SHORT_SAYINGS = 0
"""Channel of beats, their answers, notices and verdicts."""
CONFIGURATIONS = 1
"""Channel of configurations, the requests for them and descriptions: they travel reliably, so the short messages
overtake them."""

TOO_SHORT = "no seal"
WRONG_TAG = "the seal does not fit"
OLD_COUNTER = "repeated, or later than a newer one"

_UP, _DOWN = b"MsBOT from the part\0", b"MsBOT to the part\0"
_CHANNEL = Struct(">H")
_COUNTER = Struct("<I")


class Seal:
    """One end of one part's session: seals what goes, opens what comes.

    Args:
        secret: the secret from the proof (`keys.prove_sealed`).
        is_part: which end this is.
    """

    def __init__(self, secret: bytes, *, is_part: bool) -> None:
        self.refused = 0
        """Samples that `open` refused."""
        self.reason = ""
        """Why the last of them was refused, in words."""
        up, down = (hmac.digest(secret, label, "sha256") for label in (_UP, _DOWN))
        self._send_key, self._receive_key = (up, down) if is_part else (down, up)
        self._sent: dict[int, int] = {}
        self._received: dict[int, int] = {}

    @property
    def is_confirmed(self) -> bool:
        """Whether the other end has used it: it has opened something."""
        return bool(self._received)

    def seal(self, channel: int, sample: bytes) -> bytes:
        """The sample with its seal behind it.

        After 2^32 - 1 samples of a channel (50 days at 1,000 a second) the other end accepts no more: the inventory
        loses the part, which joins again with other keys.
        """
        count = self._sent[channel] = min(self._sent.get(channel, 0) + 1, LAST_COUNTER)
        counter = _COUNTER.pack(count)
        return sample + counter + _tag(self._send_key, channel, counter, sample)

    def open(self, channel: int, sealed: bytes) -> bytes | None:
        """The sample without its seal, or None: refused, which changes nothing but `refused` and `reason`."""
        size = len(sealed) - SEAL_OCTETS
        if size < 0:
            self._refuse(TOO_SHORT)
            return None
        sample, counter = sealed[:size], sealed[size : size + COUNTER_OCTETS]
        expected = _tag(self._receive_key, channel, counter, sample)
        if not hmac.compare_digest(expected, sealed[size + COUNTER_OCTETS :]):
            self._refuse(WRONG_TAG)
            return None
        (count,) = _COUNTER.unpack(counter)
        if count <= self._received.get(channel, 0):
            self._refuse(OLD_COUNTER)
            return None
        self._received[channel] = count
        return sample

    def _refuse(self, reason: str) -> None:
        self.refused += 1
        self.reason = reason


def _tag(key: bytes, channel: int, counter: bytes, sample: bytes) -> bytes:
    return hmac.digest(key, _CHANNEL.pack(channel) + counter + sample, "sha256")[:TAG_OCTETS]
