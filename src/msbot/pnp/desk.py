"""The inventory's desk: octets of a request in, octets of the answer out, or silence. Pure.

What strangers get is silence (R52, R53); the answer to a part never says more than that part needs. With `explain`
a refusal is answered with its reason, for the classroom. With `keys` a claim is answered with a question first.
"""

from __future__ import annotations

import logging

from msbot.errors import LocalProtocolError, RemoteProtocolError
from msbot.part import plug
from msbot.pnp import compat
from msbot.pnp.inventory import Inventory
from msbot.pnp.keys import Keys
from msbot.pnp.parts import Claim, Configuration, Verdict

MOST_REASONS = 64
"""Different reasons that are counted; some have a number of the sender's in their words."""
OTHER_REASONS = "(others)"

_log = logging.getLogger(__name__)


class Desk:
    """Answers the requests of parts in both layouts.

    Args:
        inventory: decides.
        explain: answer refusals with their reason; False: silence.
        keys: asks every claim for a proof; None: the robot is open.
    """

    def __init__(self, inventory: Inventory, *, explain: bool = False, keys: Keys | None = None) -> None:
        self.dropped: dict[str, int] = {}
        """Requests that were not answered because they, or their answers, made no sense; by reason in words."""
        self._inventory = inventory
        self._explain = explain
        self._keys = keys

    def compact(self, body: bytes, client_key: int, now: float, asker: bytes = b"") -> bytes | None:
        """The answer to a request of the `msbot_inventory` service, or None.

        Args:
            body: the request.
            client_key: whose session it came through.
            now: the present time.
            asker: GUID of the writer of the request, which no later session of that client has.
        """
        try:
            match plug.decode_request(body):
                case plug.Beat(lease=lease):
                    return plug.BeatReply(configuration_version=self._inventory.beat(lease, client_key, now)).encode()
                case plug.ConfigurationRequest(lease=lease):
                    configuration = self._inventory.configuration_request(lease, client_key)
                    return None if configuration is None else configuration_message(configuration).encode()
                case plug.Claim() as message:
                    return self._answer_to(claim_of(message), client_key, asker, now)
                case plug.Proof(proof=proof):
                    return self._take_proof(proof, client_key, asker, now)
        except RemoteProtocolError as error:
            self.drop(f"request: {error}")
        except LocalProtocolError as error:
            _log.warning("an answer to client %08X cannot be encoded: %s", client_key, error)
            self.drop(f"answer: {error}")
        return None

    def compat(self, body: bytes, client_key: int, now: float) -> bytes | None:
        """The answer to a request in the thesis' layout, or None."""
        try:
            claim = compat.decode_request(body)
        except RemoteProtocolError as error:
            self.drop(f"request: {error}")
            return None
        if self._keys is not None:
            asked = self._keys.ask(claim, b"", now)
            assert asked.refused is not None
            self._inventory.refuse(claim, client_key, asked.refused, now)
            return None
        verdict = self._inventory.claim(claim, client_key, now)
        return compat.encode_reply(claim.part_number) if verdict.lease else None

    def drop(self, reason: str) -> None:
        """Count something that was not answered under its reason, or under `(others)` when there are very many."""
        if reason not in self.dropped and len(self.dropped) >= MOST_REASONS:
            reason = OTHER_REASONS
        self.dropped[reason] = self.dropped.get(reason, 0) + 1

    def _answer_to(self, claim: Claim, client_key: int, asker: bytes, now: float) -> bytes | None:
        if self._keys is None or not self._inventory.has_session(client_key):
            return self._tell(self._inventory.claim(claim, client_key, now))
        asked = self._keys.ask(claim, asker, now)
        verdict = None if asked.refused is None else self._inventory.refuse(claim, client_key, asked.refused, now)
        if asked.nonce is not None:
            return plug.Challenge(nonce=asked.nonce).encode()
        return None if verdict is None else self._tell(verdict)

    def _take_proof(self, proof: bytes, client_key: int, asker: bytes, now: float) -> bytes | None:
        if self._keys is None:
            self.drop("request: a proof that nobody asked for")
            return None
        answered = self._keys.answer(proof, asker, client_key, now)
        if answered.refused is None and answered.claim is not None:
            return self._tell(self._inventory.claim(answered.claim, client_key, now))
        standing = self._inventory.standing_of(client_key)
        if answered.is_repeated and standing is not None and standing.lease:
            return self._tell(Verdict(standing.lease, standing.configuration_version))
        assert answered.refused is not None
        return self._tell(self._inventory.refuse(answered.claim, client_key, answered.refused, now))

    def _tell(self, verdict: Verdict) -> bytes | None:
        if verdict.lease == 0 and not (self._explain and verdict.refusal):
            return None
        return verdict_message(verdict, self._inventory.timing.beat_ms).encode()


def claim_of(message: plug.Claim) -> Claim:
    """A claim as the inventory takes it."""
    return Claim(
        part_number=message.part_number,
        local_name=message.local_name,
        uid=message.uid,
        nonce=message.session_nonce,
    )


def verdict_message(verdict: Verdict, beat_ms: int) -> plug.Verdict:
    """A verdict as it travels."""
    return plug.Verdict(
        lease=verdict.lease,
        configuration_version=verdict.configuration_version,
        beat_period_ms=beat_ms,
        reason=verdict.refusal or 0,
    )


def configuration_message(configuration: Configuration) -> plug.Configuration:
    """A configuration as it travels.

    Raises:
        LocalProtocolError: a text in it is too long.
    """
    return plug.Configuration(
        version=configuration.version,
        slot=configuration.slot,
        bindings=[
            plug.PortBinding(
                port=binding.port,
                topic=binding.topic,
                topic_type=binding.type_name,
                direction=plug.Direction.PUBLISH if binding.publishes else plug.Direction.SUBSCRIBE,
                reliable=int(binding.reliable),
            )
            for binding in configuration.bindings
        ],
        settings=[plug.Setting(name=name, value=value) for name, value in configuration.settings],
    )
