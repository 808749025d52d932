"""What the packets say that keep a robot together, in sentences for everybody: beats, configurations, acknowledgements.

What parts say on their topics is told with its values by `explain_samples`. Pure.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from msbot.part.join import pnp_messages
from msbot.part.join.hardware_trouble import TroublePiece
from msbot.part.join.part_log import LEVEL_BITS, LEVEL_SHIFT, LogLevel
from msbot.pnp.model import Claim
from msbot_agent.text.sentence import Sentence, said
from msbot_xrce.messages import (
    Acknack,
    Create,
    CreateClient,
    Data,
    Delete,
    Fragment,
    GetInfo,
    Heartbeat,
    Info,
    ReadData,
    Reset,
    StatusAgent,
    StatusReply,
    Submessage,
    Timestamp,
    TimestampReply,
    WriteData,
)

_NOTICES: Final[Mapping[int, str]] = {
    pnp_messages.NoticeKind.PARTNER_LOST: "the master tells {part} that nobody speaks to one of its ports any more",
    pnp_messages.NoticeKind.PARTNER_BACK: "the master tells {part} that somebody speaks to one of its ports again",
    pnp_messages.NoticeKind.IDENTIFY: "the master asks {part} to show itself",
    pnp_messages.NoticeKind.STOP: "the master tells {part} to STOP",
    pnp_messages.NoticeKind.GO: "the master tells {part} that STOP is over",
    pnp_messages.NoticeKind.DESCRIBE: "the master asks {part} what it is",
    pnp_messages.NoticeKind.TYPE_DIFFERS: "the master tells {part} that its messages are not those of the library",
}
_SAID_TO_THE_INVENTORY: Final[Mapping[type, str]] = {
    Claim: "{part} asks to be let in, by the thesis' own program",
    pnp_messages.Proof: "{part} proves that it knows its key",
    pnp_messages.SealedProof: "{part} proves that it knows its key",
    pnp_messages.Beat: "{part} says that it is alive",
    pnp_messages.StoppedBeat: "{part} says that it is alive, and has stopped",
    pnp_messages.NatureMessage: "{part} says whether it is real or simulated",
    pnp_messages.TypeMessage: "{part} says what its messages look like",
    pnp_messages.ConfigurationRequest: "{part} asks what it does in this robot",
    pnp_messages.DescriptionMessage: "{part} says what it is",
    TroublePiece: "{part} says what is wrong with it",
    pnp_messages.VerdictMessage: "the master tells {part} whether it is let in",
    pnp_messages.Challenge: "the master asks {part} to prove that it knows its key",
    pnp_messages.SealedChallenge: "the master asks {part} to prove that it knows its key",
    pnp_messages.ConfigurationMessage: "the master tells {part} what it does in this robot",
}
_UP: Final[Mapping[type[Submessage], str]] = {
    CreateClient: "{part} begins a conversation",
    Create: "{part} sets up what it says and hears",
    Delete: "{part} takes back what it set up, or leaves",
    ReadData: "{part} asks to be told what is said",
    WriteData: "{part} says something on a topic that is not known here",
    Heartbeat: "{part} asks whether everything has arrived",
    Fragment: "{part} sends a piece of a long message",
    GetInfo: "{part} asks who is there",
    Info: "{part} says who it is",
    Reset: "{part} starts over",
    Timestamp: "{part} asks what time it is",
}
_DOWN: Final[Mapping[type[Submessage], str]] = {
    StatusAgent: "the master answers {part}, which wants to begin a conversation",
    StatusReply: "the master answers what {part} has asked for",
    Data: "{part} hears something on a topic that is not known here",
    Heartbeat: "the master asks {part} whether everything has arrived",
    Fragment: "the master sends {part} a piece of a long message",
    GetInfo: "the master asks whether {part} is there",
    Info: "the master says who it is",
    Reset: "the master starts over with {part}",
    TimestampReply: "the master tells {part} what time it is",
}
FORMS: Final = (*_NOTICES.values(), *_SAID_TO_THE_INVENTORY.values(), *_UP.values(), *_DOWN.values())
"""All forms of these tables, for whoever looks for their translations."""


def inventory_sentence(message: object, part: str) -> Sentence | None:
    """What a part and the inventory say to each other."""
    match message:
        case pnp_messages.ClaimMessage():
            return said("{part} shows its part number, {number}", part=part, number=message.part_number)
        case pnp_messages.BeatReply(configuration_version=0):
            return said("the master does not know {part} any more", part=part)
        case pnp_messages.BeatReply():
            return said("the master has heard that {part} is alive", part=part)
        case pnp_messages.ConfigurationMessage(
            slot="", settings=[pnp_messages.Setting(name=pnp_messages.HELP_SETTING)]
        ):
            return said("the master tells {part} why it is not let in", part=part)
        case pnp_messages.Notice():
            form = _NOTICES.get(message.kind)
        case TroublePiece(place=place) if level := (place & LEVEL_BITS) >> LEVEL_SHIFT:
            is_line = level in (one.value for one in LogLevel)
            return said("{part} says a line of its log" if is_line else "{part} says its version", part=part)
        case pnp_messages.ProfileMessage():
            return said("{part} hears which robot this is: {robot}", part=part, robot=message.message)
        case _:
            form = _SAID_TO_THE_INVENTORY.get(type(message))
    return None if form is None else said(form, part=part)


def submessage_sentence(submessage: Submessage, part: str, *, up: bool) -> Sentence | None:
    """What a submessage is for, from that part (`up`) or to it."""
    if isinstance(submessage, Acknack):
        if submessage.bitmap:
            asks = "{part} asks again for what is missing" if up else "the master asks {part} again for what is missing"
            return said(asks, part=part)
        has = "{part} has received everything so far" if up else "the master has received everything from {part} so far"
        return said(has, part=part)
    form = (_UP if up else _DOWN).get(type(submessage))
    return None if form is None else said(form, part=part)


def piece_sentence(part: str, *, up: bool) -> Sentence:
    """A frame that is a piece of a longer message."""
    return said("a piece of what {part} sends" if up else "a piece of what the master sends to {part}", part=part)
