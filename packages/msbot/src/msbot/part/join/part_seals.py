"""Which seals a part uses now: none, those of its latest proof, or those of its lease. Pure.

Every proof makes a new secret, which counts from the first reply that it opens. A part that was in a robot with sealed
samples accepts nothing unsealed as long as it runs: nobody can make it join an open "robot" by breaking its session.
"""

from __future__ import annotations

import logging

from msbot.part.join import pnp_messages
from msbot.part.join.seal import SEAL_OCTETS, TOO_SHORT, Seal

_log = logging.getLogger("msbot.part")


class PartSeals:
    """The seals of one part."""

    def __init__(self) -> None:
        self.refused = 0
        """Samples and replies without a good seal, which changed nothing."""
        self._present: Seal | None = None
        self._proved: Seal | None = None
        self._insists = False

    def proved(self, secret: bytes) -> None:
        """A proof with that secret is on its way."""
        self._proved = Seal(secret, is_part=True)

    def session_lost(self) -> None:
        """Everything agreed in the session is void."""
        self._present = self._proved = None

    def open_reply(self, payload: bytes) -> bytes | None:
        """What the inventory says, without its seal; None: refused."""
        if not pnp_messages.is_sealed_reply(len(payload)) or self._may_be_unsealed(payload):
            return payload
        channel = pnp_messages.channel_of_reply(len(payload) - SEAL_OCTETS)
        reason = TOO_SHORT
        for seal in self._usable():
            opened = seal.open(channel, payload)
            if opened is not None:
                self._present, self._insists = seal, True
                if seal is self._proved:
                    self._proved = None
                return opened
            reason = seal.reason
        self._refuse(reason)
        return None

    def open(self, object_id: int, payload: bytes) -> bytes | None:
        """A sample for a data reader, without its seal; None: refused."""
        if self._present is None:
            return payload
        for seal in self._usable():
            opened = seal.open(object_id, payload)
            if opened is not None:
                return opened
        self._refuse(self._present.reason)
        return None

    def seal(self, object_id: int, payload: bytes) -> bytes:
        """A sample of a data writer, with its seal."""
        return payload if self._present is None else self._present.seal(object_id, payload)

    def seal_request(self, request: bytes) -> bytes:
        """A request to the inventory, with its seal if it has one."""
        if self._present is None or not pnp_messages.is_sealed_request(len(request)):
            return request
        return self._present.seal(pnp_messages.channel_of_request(len(request)), request)

    def _may_be_unsealed(self, payload: bytes) -> bool:
        if self._present is not None:
            return False
        if len(payload) == pnp_messages.NONCE_OCTETS and not self._insists:
            self._proved = None  # a plain challenge: this robot seals nothing, whatever was said before
        return pnp_messages.is_refusal(payload) or (self._proved is None and not self._insists)

    def _usable(self) -> list[Seal]:
        return [seal for seal in (self._proved, self._present) if seal is not None]

    def _refuse(self, reason: str) -> None:
        self.refused += 1
        if self.refused == 1:
            _log.warning("refused a sample: %s (said once, counted from now on)", reason)
