"""The seals of one robot's parts, by session, with `authentication = "key+data"`. Pure."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeVar

from msbot.part.join import pnp_messages
from msbot.part.join.seal import COUNTER_OCTETS, SEAL_OCTETS, Seal
from msbot_xrce.errors import RemoteProtocolError


class SessionSeals:
    """Which seal belongs to which session (see `msbot.part.join.seal`).

    Args:
        changed: called with the key of every session whose seal has changed.
    """

    def __init__(self, changed: Callable[[int], None]) -> None:
        self._changed = changed
        self._seals: dict[int, Seal] = {}

    def of(self, client_key: int) -> Seal | None:
        """The seal of that session; None: its samples are not sealed."""
        return self._seals.get(client_key)

    def put(self, client_key: int, secret: bytes) -> None:
        """A session has proved its key, which produced that secret."""
        self._seals[client_key] = Seal(secret, is_part=False)
        self._changed(client_key)

    def drop(self, client_key: int) -> None:
        """A session has ended, or started over."""
        self._seals.pop(client_key, None)


# Where the sample ends and its seal begins, for somebody who only listens to a session. Pure.
#
# In a robot with `authentication = "key+data"` a seal of 10 octets follows most samples (`msbot.part.join.seal`). Who
# listens has no key and cannot check it, but can tell that it is there: the session has shown a challenge for sealed
# samples, or a message of a length that only a sealed one has, or the sample makes sense without its last octets alone.


T = TypeVar("T")
Read = tuple[T, int | None]
"""A message, and the number in the seal behind it; None: it has no seal."""

AMBIGUOUS: Final = "a Proof or a sealed StoppedBeat: which one only the beginning of the session tells"


class ObservedSeals:
    """What one session has shown of its seals."""

    def __init__(self, *, sealed: bool | None = None) -> None:
        """Listen to one session; `sealed`: whether it has seals, if that is known before."""
        self._is_sealed = bool(sealed)
        self._heard_from_the_beginning = sealed is not None

    def begin(self) -> None:
        """A session begins: whatever holds will be agreed again."""
        self._is_sealed = False
        self._heard_from_the_beginning = True

    def sample(self, payload: bytes, decode: Callable[[bytes], T]) -> Read[T]:
        """Read a sample of a topic.

        Raises:
            RemoteProtocolError: it makes no sense, with or without a seal.
        """
        return self._read(payload, decode, sealed_first=self._is_sealed)

    def request(self, payload: bytes) -> Read[pnp_messages.Request]:
        """Read what a part asks of the inventory.

        Raises:
            RemoteProtocolError: it makes no sense, or could be either of two messages.
        """
        size = len(payload)
        if size == pnp_messages.PROOF_OCTETS and not (self._is_sealed or self._heard_from_the_beginning):
            raise RemoteProtocolError(AMBIGUOUS)
        found = self._read(
            payload, pnp_messages.decode_request, sealed_first=self._is_sealed and pnp_messages.is_sealed_request(size)
        )
        self._is_sealed |= found[1] is not None
        return found

    def reply(self, payload: bytes) -> Read[pnp_messages.Reply]:
        """Read what the inventory says.

        Raises:
            RemoteProtocolError: it makes no sense.
        """
        has_seal = pnp_messages.is_sealed_reply(len(payload)) and not pnp_messages.is_refusal(payload)
        found = self._read(payload, pnp_messages.decode_reply, sealed_first=self._is_sealed and has_seal)
        self._is_sealed |= found[1] is not None or isinstance(found[0], pnp_messages.SealedChallenge)
        return found

    def _read(self, payload: bytes, decode: Callable[[bytes], T], *, sealed_first: bool) -> Read[T]:
        first, second = (_without_seal, _as_it_is) if sealed_first else (_as_it_is, _without_seal)
        try:
            return first(payload, decode)
        except RemoteProtocolError as error:
            try:
                return second(payload, decode)
            except RemoteProtocolError:
                raise error from None


def _as_it_is(payload: bytes, decode: Callable[[bytes], T]) -> Read[T]:
    return decode(payload), None


def _without_seal(payload: bytes, decode: Callable[[bytes], T]) -> Read[T]:
    size = len(payload) - SEAL_OCTETS
    if size < 0:
        raise RemoteProtocolError("too short for a seal")
    return decode(payload[:size]), int.from_bytes(payload[size : size + COUNTER_OCTETS], "little")
