"""Plug-and-play on the wire: the profile of step 1 and the inventory service of step 2.

One service carries everything that a part and the inventory say to each other; the length of a request or reply tells
what it is, which keeps a beat at 4 octets (one classic CAN frame with header compression):

========================  =======================================  ==============
from the part             answer of the inventory                  octets
========================  =======================================  ==============
`ClaimMessage`            `VerdictMessage`, or none to a stranger  28 or more, 12
`ClaimMessage`, key mode  `Challenge`                              28 or more, 16
`Proof`                   `VerdictMessage`, or none                16, 12
`Beat`                    `BeatReply`                              4, 4
`NatureMessage`           none                                     5
`TypeMessage`             `Notice` if the library's type differs   13
`StoppedBeat`             `BeatReply`                              6, 4
`ConfigurationRequest`    `ConfigurationMessage`                   8, 20 or more
`ClaimMessage`, key+data  `SealedChallenge`                        28 or more, 17
`SealedProof`             `VerdictMessage`                         24, 12
`DescriptionMessage`      none                                     536 or more
`TroublePiece`            none                                     17
========================  =======================================  ==============

The inventory may also speak unasked: a `VerdictMessage` (a standby part has been given a slot), a `BeatReply`
(the configuration has changed, or the lease is void) and a `Notice` (8 octets), which may ask for a
`DescriptionMessage`.

In a robot with `authentication = "key+data"` everything but claims, challenges and proofs is followed by a seal of 10
octets (`msbot.part.join.seal`).

Claim, verdict and configuration as the inventory handles them are values of `msbot.pnp`; here they are messages.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated

from msbot.part.join.hardware_trouble import TROUBLE_PIECE_OCTETS, TroublePiece
from msbot.part.join.seal import CONFIGURATIONS, SHORT_SAYINGS
from msbot.part.messages.message import Message
from msbot.part.messages.type_hash import HASH_OCTETS
from msbot.part.messages.wire_types import AtMost, Octets, uint8, uint16, uint32

PROFILE_TOPIC = "msbot_masterTopic"
PROFILE_TYPE = "msbot_master"
PROFILE_PERIOD_S = 5.0
"""Time between two publications of the master's profile (thesis 3.12.1)."""

INVENTORY_SERVICE = "msbot_inventory"
INVENTORY_REQUEST_TOPIC = "msbot_inventory_Request"
INVENTORY_REPLY_TOPIC = "msbot_inventory_Reply"
INVENTORY_REQUEST_TYPE = "msbot_inventory_request"
INVENTORY_REPLY_TYPE = "msbot_inventory_reply"

UID_OCTETS = 8
TEXT_OCTETS = 254
"""Longest text of the profile and of a claim: the original's `char[255]` with its NUL."""

NONCE_OCTETS = 16
PROOF_OCTETS = 16
SEALED_PROOF_OCTETS = 24
"""A length that no sealed request has."""

STOP_SETTING = ".stop"
"""Name of the setting that tells a part joining during STOP; its value is the number of that STOP. The part is thus
stopped before it is active, and no notice can be lost on the way. Names of parameters have no dot."""

HELP_SETTING = ".why"
"""Name of the one setting of a configuration without version and slot: why a part is not let in, and what helps. Parts
that do not know it take no configuration before they are let in."""

SAFE_MARK = ".safe."
"""In the name of a setting: `PORT.safe.FIELD` is a field of the port's safe value. Names of parameters have no dot."""

RANGE_MARK = ".range."
"""In the name of a setting: `PORT.range.FIELD` has the least and the greatest value of a field that makes sense at a
port that publishes, with a space between them."""

MOST_DESCRIPTION = 4096
"""Longest description of a part, in octets of UTF-8."""
LEAST_DESCRIPTION = 540
"""Shortest one; newlines fill it up, because the length of a request tells what it is, and claims are shorter."""

OF_REPLY = 0x80
"""Bit of `TypeMessage.binding` and of the `binding` of a notice `TYPE_DIFFERS`: it is a service's reply."""

DESCRIPTION_BEGINS = "number = "
"""With this begins a part's own description, and no text with the fields of its messages."""

MOST_BINDINGS = 120
"""Ports of one part that a configuration can bind: each takes two of the 256 objects that an agent grants a client."""

Text = Annotated[str, AtMost(TEXT_OCTETS)]


class ProfileMessage(Message):
    """Step 1: what the master publishes about the robot; the thesis defines the fields by their position."""

    type_name = PROFILE_TYPE

    index: uint32
    """Number of this publication, counted from 1."""
    message: Text
    """Robot name, `MSBOT_MASTER`."""
    name: Text
    """Version, `MSBOT_V1`."""
    id: Text
    """Serial number, `X100Y100Z100`."""
    dof: Text
    """Release date, `8-4-2021`."""
    make: Text
    """Manufacturer, `MASSEY_ENGINEERING_DEP`."""


class ClaimMessage(Message):
    """Step 2: a part asks for its place."""

    type_name = "Claim"

    part_number: Text
    local_name: Text
    uid: Annotated[bytes, Octets(UID_OCTETS)]
    """Identifies the piece of hardware."""
    session_nonce: uint32
    """Drawn at random at each start of the part, to distinguish two devices with the same UID."""


class Challenge(Message):
    """The answer to a claim in a robot with keys: prove that you know the key of your UID."""

    nonce: Annotated[bytes, Octets(NONCE_OCTETS)]
    """Never used before; good for one proof."""


class Proof(Message):
    """The answer of a part to a challenge, see `msbot.part.join.part_keys`."""

    proof: Annotated[bytes, Octets(PROOF_OCTETS)]


class SealedChallenge(Message):
    """The same in a robot whose samples are sealed: a part that cannot seal must not join."""

    nonce: Annotated[bytes, Octets(NONCE_OCTETS)]
    version: uint8 = 1
    """How samples are sealed."""


class SealedProof(Message):
    """The answer of a part that can seal its samples, see `msbot.part.join.part_keys`."""

    proof: Annotated[bytes, Octets(SEALED_PROOF_OCTETS)]


class VerdictMessage(Message):
    """The answer to a claim."""

    type_name = "Verdict"

    lease: uint32
    """The number to show with every beat; 0 = refused."""
    configuration_version: uint32
    beat_period_ms: uint16
    reason: uint8 = 0
    """`msbot.part.join.refusal.Refusal` if refused and the robot explains refusals, else 0."""
    reserved: uint8 = 0


class Beat(Message):
    """A part says that it is alive."""

    lease: uint32


class StoppedBeat(Message):
    """A beat that also says: STOP has arrived, and every port has its safe value.

    Only this confirms a STOP. It costs two octets more than a `Beat`, and only while STOP holds.

    With number 0 it says STOP: somebody has said it at the part or on its bus, and no master has told its number yet,
    or a button there is still pressed. A number that the master has never counted to says STOP as well: the part obeys
    one that a master before has told.
    """

    lease: uint32
    number: uint16
    """The lowest 16 bits of the number of the STOP that the part obeys, which are never 0; 0 = it says STOP."""


class Nature(IntEnum):
    """What is behind a part's ports."""

    UNKNOWN = 0
    """The part does not say."""
    REAL = 1
    """Hardware."""
    SIMULATED = 2
    """A model of it."""
    REPLAYED = 3
    """A recording of what was there once."""

    @classmethod
    def of(cls, number: int) -> Nature:
        """The nature with that number; a number of a later version is `UNKNOWN`."""
        return cls(number) if number in set(cls) else cls.UNKNOWN

    @property
    def label(self) -> str:
        """In one word; empty if it is not known."""
        return "" if self is Nature.UNKNOWN else self.name.lower()


class NatureMessage(Message):
    """A part says what is behind its ports, once, after it has become active; not answered."""

    lease: uint32
    nature: uint8
    """`Nature`; another number counts as unknown."""


class TypeMessage(Message):
    """A part says what messages its program has at a port: the hash of their type (`msbot.part.messages.type_hash`)."""

    lease: uint32
    binding: uint8
    """Which of the configuration's bindings, counted from 0; for a service's reply, with `OF_REPLY`."""
    hash: Annotated[bytes, Octets(HASH_OCTETS)]


class DescriptionMessage(Message):
    """What a part says of itself when it is asked: the text of a library file (`msbot.part.description`); after a
    notice of kind `TYPE_DIFFERS` the fields of its messages (`msbot.part.messages.type_hash`)."""

    type_name = "Description"

    text: Annotated[str, AtMost(MOST_DESCRIPTION)]
    """TOML, at least `LEAST_DESCRIPTION` octets."""


class BeatReply(Message):
    """The answer to a beat."""

    configuration_version: uint32
    """The part's current one; 0 = the lease is unknown: claim again."""


class ConfigurationRequest(Message):
    """A part asks for its configuration."""

    lease: uint32
    have_version: uint32
    """The version in use, 0 = none yet."""


class BindingDirection(IntEnum):
    """Which way the samples of a bound port go, seen from the part."""

    PUBLISH = 0
    SUBSCRIBE = 1
    SERVE = 2
    """Requests come in, replies go out; the topic's type is `Request -> Reply`."""
    CALL = 3
    """Requests go out, replies come in."""


class PortBinding(Message):
    """One port of the part tied to one topic of the robot."""

    port: Text
    topic: Text
    topic_type: Text
    direction: uint8
    """`BindingDirection`."""
    reliable: uint8
    """1 = reliable stream, 0 = best effort."""


class Setting(Message):
    """One parameter of the part, as text; the part knows its type."""

    name: str
    value: str


class ConfigurationMessage(Message):
    """The answer to a configuration request: what this part does in this robot."""

    type_name = "Configuration"

    version: uint32
    slot: Text
    bindings: Annotated[list[PortBinding], AtMost(MOST_BINDINGS)]
    settings: list[Setting]


class NoticeKind(IntEnum):
    """What a notice is about."""

    PARTNER_LOST = 1
    """Nobody publishes any more what the port subscribes to."""
    PARTNER_BACK = 2
    """Somebody publishes it again."""
    IDENTIFY = 3
    """Make yourself noticed by the people in the room: blink, beep."""
    STOP = 4
    """Go to the safe state, and stay in it."""
    GO = 5
    """STOP is over."""
    DESCRIBE = 6
    """Say what you are: the library does not know your part number, or a person adopts you anew."""
    TYPE_DIFFERS = 7
    """The library's type of the port has other fields than the part's program. `detail` 0: say which ones it has."""


class Notice(Message):
    """Said to a part unasked, best effort."""

    number: uint32
    """For a partner: the version of the configuration that `binding` is in. For STOP and GO: which STOP, counted from 1
    by the master, so that the GO of an earlier one does not end it. Else 0."""
    binding: uint16
    """Which of the configuration's bindings, counted from 0; 0xFFFF = none."""
    kind: uint8
    """`NoticeKind`."""
    detail: uint8 = 0
    """For `TYPE_DIFFERS`: the place of the first field that differs, counted from 1; 255 = not known. Else 0."""


NO_BINDING = 0xFFFF
"""`Notice.binding` of a notice that is about the part as a whole."""


_BEAT_OCTETS = 4
_NATURE_OCTETS = 5
_STOPPED_BEAT_OCTETS = 6
_TYPE_OCTETS = 13
_CONFIGURATION_REQUEST_OCTETS = 8
_NOTICE_OCTETS = 8
_VERDICT_OCTETS = 12
_SEALED_CHALLENGE_OCTETS = 17

SHORTEST_CLAIM_OCTETS = 28
LONGEST_CLAIM_OCTETS = 535
"""Two texts of 254 octets, UID and nonce (532 octets), and up to 3 octets of padding."""

Request = (
    Beat
    | NatureMessage
    | TypeMessage
    | StoppedBeat
    | ConfigurationRequest
    | Proof
    | TroublePiece
    | SealedProof
    | DescriptionMessage
    | ClaimMessage
)
"""What a part asks of the inventory."""


def decode_request(payload: bytes) -> Request:
    """Decode what a part asks of the inventory; its length tells which message it is.

    Raises:
        RemoteProtocolError: it is none of these.
    """
    if len(payload) == _BEAT_OCTETS:
        return Beat.decode(payload)
    if len(payload) == _NATURE_OCTETS:
        return NatureMessage.decode(payload)
    if len(payload) == _TYPE_OCTETS:
        return TypeMessage.decode(payload)
    if len(payload) == _STOPPED_BEAT_OCTETS:
        return StoppedBeat.decode(payload)
    if len(payload) == _CONFIGURATION_REQUEST_OCTETS:
        return ConfigurationRequest.decode(payload)
    if len(payload) == PROOF_OCTETS:
        return Proof.decode(payload)
    if len(payload) == TROUBLE_PIECE_OCTETS:
        return TroublePiece.decode(payload)
    if len(payload) == SEALED_PROOF_OCTETS:
        return SealedProof.decode(payload)
    if len(payload) > LONGEST_CLAIM_OCTETS:
        return DescriptionMessage.decode(payload)
    return ClaimMessage.decode(payload)


Reply = BeatReply | Notice | VerdictMessage | Challenge | SealedChallenge | ConfigurationMessage
"""What the inventory says to a part."""


def decode_reply(payload: bytes) -> Reply:
    """Decode what the inventory says; its length tells which message it is.

    Raises:
        RemoteProtocolError: it is none of these.
    """
    if len(payload) == _BEAT_OCTETS:
        return BeatReply.decode(payload)
    if len(payload) == _NOTICE_OCTETS:
        return Notice.decode(payload)
    if len(payload) == NONCE_OCTETS:
        return Challenge.decode(payload)
    if len(payload) == _SEALED_CHALLENGE_OCTETS:
        return SealedChallenge.decode(payload)
    if len(payload) == _VERDICT_OCTETS:
        return VerdictMessage.decode(payload)
    return ConfigurationMessage.decode(payload)


def is_sealed_request(octets: int) -> bool:
    """Whether a request of that length has a seal where samples are sealed: all but claims and their proofs."""
    is_short = octets < SHORTEST_CLAIM_OCTETS and octets != SEALED_PROOF_OCTETS
    return is_short or octets > LONGEST_CLAIM_OCTETS


def is_sealed_reply(octets: int) -> bool:
    """The same for what the inventory says: all but the challenge."""
    return octets != _SEALED_CHALLENGE_OCTETS


def is_refusal(payload: bytes) -> bool:
    """Whether a reply is a verdict without a lease, which has no seal before there is a lease."""
    return len(payload) == _VERDICT_OCTETS and not any(payload[:4])


def channel_of_request(octets: int) -> int:
    """The channel of the seal of a request that has that length without it."""
    is_reliable = octets == _CONFIGURATION_REQUEST_OCTETS or octets > LONGEST_CLAIM_OCTETS
    return CONFIGURATIONS if is_reliable else SHORT_SAYINGS


def channel_of_reply(octets: int) -> int:
    """The channel of the seal of a reply that has that length without it."""
    return CONFIGURATIONS if octets > _VERDICT_OCTETS else SHORT_SAYINGS


def range_setting(port: str, field: str) -> str:
    """The name of the setting that carries the range of a field."""
    return f"{port}{RANGE_MARK}{field}"


def safe_setting(port: str, field: str) -> str:
    """The name of the setting that carries a field of a port's safe value."""
    return f"{port}{SAFE_MARK}{field}"
