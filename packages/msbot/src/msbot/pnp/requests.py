"""Requests to the inventory: octets of a request in, octets of the answer out, or silence. Pure.

Strangers get silence (R52, R53); the answer to a part never says more than that part needs. With `explain`
a refusal is answered with its reason, for the classroom. With `keys` a claim is answered with a question first.
"""

from __future__ import annotations

import logging
from collections.abc import Callable

from msbot.part.join import pnp_messages, thesis_messages
from msbot.part.join.hardware_trouble import TroublePiece
from msbot.part.join.seal import SEAL_OCTETS
from msbot.pnp.inventory import Inventory
from msbot.pnp.inventory_record import InventoryRecord
from msbot.pnp.key_proof import Keys
from msbot.pnp.model import Claim, Configuration, SlotBinding, Verdict
from msbot.pnp.part_events import PartState
from msbot.pnp.thesis_claims import decode_thesis_claim
from msbot_xrce.counting import Tally
from msbot_xrce.errors import LocalProtocolError, RemoteProtocolError

_log = logging.getLogger(__name__)


class RequestHandler:
    """Answers the requests of parts in both layouts.

    Args:
        inventory: decides.
        explain: answer refusals with their reason; False: silence.
        keys: asks every claim for a proof; None: the robot is open.
        complete: adds to a configuration what its part needs besides.
    """

    def __init__(
        self,
        inventory: Inventory,
        *,
        explain: bool = False,
        keys: Keys | None = None,
        complete: Callable[[Configuration], Configuration] = lambda configuration: configuration,
    ) -> None:
        self.dropped = Tally()
        """Requests that were not answered because they or their answers were malformed; by reason in words."""
        self._inventory = inventory
        self._explain = explain
        self._keys = keys
        self._complete = complete

    def compact(self, body: bytes, client_key: int, now: float, asker: bytes = b"") -> bytes | None:
        """The answer to a request of the `msbot_inventory` service, or None.

        Args:
            body: the request.
            client_key: the session that it came through.
            now: the present time.
            asker: GUID of the writer of the request, which no later session of that client has.
        """
        request = self.read(body, client_key, now)
        return None if request is None else self.encode(self.answer(request, client_key, now, asker), client_key)

    def read(self, body: bytes, client_key: int, now: float) -> pnp_messages.Request | None:
        """The request in these octets; None: it is malformed or its seal is wrong, which is counted."""
        opened = self._opened(body, client_key, now)
        if opened is None:
            return None
        try:
            return pnp_messages.decode_request(opened)
        except RemoteProtocolError as error:
            self.dropped.count(f"request: {error}")
            self._inventory.descriptions.unreadable(client_key, len(opened), str(error), now)
            return None

    def answer(
        self, request: pnp_messages.Request, client_key: int, now: float, asker: bytes = b""
    ) -> pnp_messages.Reply | None:
        """The answer to a request, or None: silence. Arguments as for `compact`."""
        match request:
            case pnp_messages.Beat(lease=lease) | pnp_messages.StoppedBeat(lease=lease):
                return pnp_messages.BeatReply(configuration_version=self._inventory.beat(lease, client_key, now))
            case pnp_messages.NatureMessage(lease=lease, nature=nature):
                if (record := self._inventory.with_lease(lease, client_key)) is None:
                    self.dropped.count("nature with an unknown lease")
                else:
                    record.take_nature(nature)
                return None
            case pnp_messages.TypeMessage(lease=lease, binding=place, hash=octets):
                if (record := self._inventory.with_lease(lease, client_key)) is None:
                    self.dropped.count("hash of a type with an unknown lease")
                    return None
                return self._inventory.types.receive_hash(record, place, octets, now)
            case pnp_messages.DescriptionMessage() if self._fields_of(request, client_key):
                return None  # the answers are several notices: `fields_told`
            case pnp_messages.DescriptionMessage(text=text):
                self._inventory.descriptions.receive_description(client_key, text, now)
                return None
            case TroublePiece(lease=lease, place=place, text=text):
                if not self._inventory.piece_told(lease, client_key, place, text, now):
                    self.dropped.count("trouble with an unknown lease")
                return None
            case pnp_messages.ConfigurationRequest(lease=lease):
                configuration = self._inventory.configuration_request(lease, client_key)
                return None if configuration is None else self._configuration_message(configuration, client_key)
            case pnp_messages.ClaimMessage() as message:
                return self._answer_to(claim_of(message), client_key, asker, now)
            case pnp_messages.Proof(proof=proof) | pnp_messages.SealedProof(proof=proof):
                return self._take_proof(proof, client_key, asker, now)

    def fields_told(
        self, request: pnp_messages.Request | None, client_key: int, now: float
    ) -> list[pnp_messages.Notice]:
        """What to answer to the fields of a part's messages, if the request has them."""
        if not isinstance(request, pnp_messages.DescriptionMessage):
            return []
        record = self._fields_of(request, client_key)
        return [] if record is None else self._inventory.types.fields_told(record, request.text, now)

    def _fields_of(self, request: pnp_messages.DescriptionMessage, client_key: int) -> InventoryRecord | None:
        """The part that tells the fields of its messages by that; None: it says what it is."""
        is_fields = not request.text.startswith(pnp_messages.DESCRIPTION_BEGINS)
        return self._inventory.waits_for_fields(client_key) if is_fields else None

    def asks_what(self, request: pnp_messages.Request, client_key: int) -> bool:
        """Whether to ask the part behind a request what it is: only where strangers get an answer, or after a proof."""
        is_claim = isinstance(request, pnp_messages.ClaimMessage | pnp_messages.Proof | pnp_messages.SealedProof)
        return is_claim and (self._explain or self._keys is not None) and self._inventory.descriptions.ask(client_key)

    def encode(self, reply: pnp_messages.Reply | None, client_key: int) -> bytes | None:
        """The octets of an answer; None: there is none, or it cannot be encoded, which is counted."""
        if reply is None:
            return None
        try:
            octets = reply.encode()
        except LocalProtocolError as error:
            self._cannot_be_said(error, client_key)
            return None
        seal = self._inventory.seals.of(client_key)
        if seal is None or not pnp_messages.is_sealed_reply(len(octets)):
            return octets
        return seal.seal(pnp_messages.channel_of_reply(len(octets)), octets)

    def _opened(self, body: bytes, client_key: int, now: float) -> bytes | None:
        if self._keys is None or not self._keys.sealed or not pnp_messages.is_sealed_request(len(body)):
            return body
        seal = self._inventory.seals.of(client_key)
        if seal is None:  # before there is a lease, nothing can be judged: a beat of the session before, most likely
            self.dropped.count("request without a good seal")
            return None
        opened = seal.open(pnp_messages.channel_of_request(len(body) - SEAL_OCTETS), body)
        if opened is None:
            self.dropped.count("request without a good seal")
            if seal.is_confirmed:  # before, it may be sealed as the part was told last, and on its way
                self._inventory.sample_refused(client_key, seal.reason, now)
        return opened

    def _configuration_message(
        self, configuration: Configuration, client_key: int
    ) -> pnp_messages.ConfigurationMessage | None:
        try:
            return configuration_message(self._complete(configuration))
        except LocalProtocolError as error:
            self._cannot_be_said(error, client_key)
            return None

    def _cannot_be_said(self, error: LocalProtocolError, client_key: int) -> None:
        _log.warning("an answer to client %08X cannot be encoded: %s", client_key, error)
        self.dropped.count(f"answer: {error}")

    def compat(self, body: bytes, client_key: int, now: float) -> bytes | None:
        """The answer to a request in the thesis' layout, or None."""
        if thesis_messages.is_probe_request(body):
            return None  # a part that nobody here answers wants to know whether this is the thesis' own master
        try:
            claim = decode_thesis_claim(body)
        except RemoteProtocolError as error:
            self.dropped.count(f"request: {error}")
            return None
        if self._keys is not None:
            asked = self._keys.ask(claim, b"", now)
            assert asked.refused is not None
            self._inventory.refuse(claim, client_key, asked.refused, now)
            return None
        verdict = self._inventory.claim(claim, client_key, now)
        return thesis_messages.encode_reply(claim.part_number) if verdict.lease else None

    def _answer_to(self, claim: Claim, client_key: int, asker: bytes, now: float) -> pnp_messages.Reply | None:
        if self._keys is None or self._inventory.shown_key(client_key) is None:
            return self._tell(self._inventory.claim(claim, client_key, now))
        asked = self._keys.ask(claim, asker, now)
        verdict = None if asked.refused is None else self._inventory.refuse(claim, client_key, asked.refused, now)
        if asked.nonce is not None:
            kind = pnp_messages.SealedChallenge if self._keys.sealed else pnp_messages.Challenge
            return kind(nonce=asked.nonce)
        return None if verdict is None else self._tell(verdict)

    def _take_proof(self, proof: bytes, client_key: int, asker: bytes, now: float) -> pnp_messages.Reply | None:
        if self._keys is None:
            self.dropped.count("request: a proof that nobody asked for")
            return None
        answered = self._keys.answer(proof, asker, self._inventory.shown_key(client_key) or client_key, now)
        if answered.refused is None and answered.claim is not None:
            if answered.secret:
                self._inventory.seals.put(client_key, answered.secret)
            return self._tell(self._inventory.claim(answered.claim, client_key, now))
        standing = self._inventory.standing_of(client_key)
        if answered.is_repeated and standing is not None and standing.lease:
            return self._tell(Verdict(standing.lease, standing.configuration_version))
        if answered.is_repeated and standing is not None and standing.state is PartState.STANDBY:
            return None  # what it proved has been judged: it waits for a slot
        assert answered.refused is not None
        return self._tell(self._inventory.refuse(answered.claim, client_key, answered.refused, now))

    def _tell(self, verdict: Verdict) -> pnp_messages.VerdictMessage | None:
        if verdict.lease == 0 and not (self._explain and verdict.refusal):
            return None
        return verdict_message(verdict, self._inventory.timing.beat_ms)


def claim_of(message: pnp_messages.ClaimMessage) -> Claim:
    """A claim in the form that the inventory uses."""
    return Claim(
        part_number=message.part_number,
        local_name=message.local_name,
        uid=message.uid,
        nonce=message.session_nonce,
    )


def verdict_message(verdict: Verdict, beat_ms: int) -> pnp_messages.VerdictMessage:
    """A verdict as a message."""
    return pnp_messages.VerdictMessage(
        lease=verdict.lease,
        configuration_version=verdict.configuration_version,
        beat_period_ms=beat_ms,
        reason=verdict.refusal or 0,
    )


def configuration_message(configuration: Configuration) -> pnp_messages.ConfigurationMessage:
    """A configuration as a message.

    Raises:
        LocalProtocolError: a text in it is too long.
    """
    return pnp_messages.ConfigurationMessage(
        version=configuration.version,
        slot=configuration.slot,
        bindings=[
            pnp_messages.PortBinding(
                port=binding.port,
                topic=binding.topic,
                topic_type=binding.type_name,
                direction=_direction(binding),
                reliable=int(binding.reliable),
            )
            for binding in configuration.bindings
        ],
        settings=[pnp_messages.Setting(name=name, value=value) for name, value in configuration.settings],
    )


def _direction(binding: SlotBinding) -> pnp_messages.BindingDirection:
    way = pnp_messages.BindingDirection
    if binding.is_service:
        return way.SERVE if binding.publishes else way.CALL
    return way.PUBLISH if binding.publishes else way.SUBSCRIBE
