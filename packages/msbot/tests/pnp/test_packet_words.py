"""What packets are for, in sentences: every message between part and inventory, and every kind of submessage."""

from __future__ import annotations

from typing import Any, get_args

import pytest

from msbot.part.join import pnp_messages
from msbot.part.join.hardware_trouble import TroublePiece
from msbot.pnp.packet_words import inventory_sentence, piece_sentence, submessage_sentence
from msbot.pnp.refusal_help import help_message
from msbot_xrce.messages import Acknack, Submessage

UP, DOWN = "knob", "the master"


def filled(kind: type[Any], **values: object) -> Any:
    """A message of that kind; which values it has does not matter here."""
    made: Any = object.__new__(kind)
    for name, value in values.items():
        object.__setattr__(made, name, value)
    return made


@pytest.mark.parametrize(
    ("message", "sentence"),
    [
        (filled(pnp_messages.ClaimMessage, part_number="N-1"), "knob shows its part number, N-1"),
        (pnp_messages.BeatReply(configuration_version=0), "the master does not know knob any more"),
        (pnp_messages.BeatReply(configuration_version=1), "the master has heard that knob is alive"),
        (pnp_messages.BeatReply(configuration_version=2), "the master has heard that knob is alive"),
        (filled(pnp_messages.ProfileMessage, message="Robo"), "knob hears which robot this is: Robo"),
        (TroublePiece(lease=1, place=0x80, text=bytes(12)), "knob says what is wrong with it"),
        (TroublePiece(lease=1, place=0x90, text=bytes(12)), "knob says a line of its log"),
        (TroublePiece(lease=1, place=0xE0, text=b"C 0.1.0".ljust(12, b"\0")), "knob says its version"),
        (help_message("slot AA has AA"), "the master tells knob why it is not let in"),
        ("a text", None),
    ],
)
def test_what_a_part_and_the_inventory_say(message: object, sentence: str | None) -> None:
    assert inventory_sentence(message, "knob") == sentence


def test_every_message_of_the_inventory_has_a_sentence_of_its_own() -> None:
    requests: set[type] = {*get_args(pnp_messages.Request), TroublePiece}
    replies: set[type] = {*get_args(pnp_messages.Reply)} - {pnp_messages.Notice}
    told = {
        kind: inventory_sentence(filled(kind, configuration_version=1, part_number="N"), "knob")
        for kind in requests | replies
    }
    told |= {
        kind: inventory_sentence(pnp_messages.Notice(number=1, binding=0, kind=kind), "knob")  # type: ignore[misc]
        for kind in pnp_messages.NoticeKind
    }
    assert None not in told.values()
    alike: dict[type, type] = {
        pnp_messages.Proof: pnp_messages.SealedProof,
        pnp_messages.Challenge: pnp_messages.SealedChallenge,
    }
    for one, other in alike.items():
        assert told.pop(other) == told[one]
    assert len(set(told.values())) == len(told)
    for kind, sentence in told.items():
        says = sentence is not None and sentence.startswith(UP)
        assert says is (kind in requests), kind
    assert inventory_sentence(pnp_messages.Notice(number=1, binding=0, kind=200), "knob") is None


@pytest.mark.parametrize(
    ("bitmap", "up", "sentence"),
    [
        (0, True, "knob has received everything so far"),
        (5, True, "knob asks again for what is missing"),
        (0, False, "the master has received everything from knob so far"),
        (5, False, "the master asks knob again for what is missing"),
    ],
)
def test_what_an_acknack_says(bitmap: int, up: bool, sentence: str) -> None:
    assert submessage_sentence(Acknack(7, bitmap, 0x80), "knob", up=up) == sentence


def test_every_submessage_is_for_something_in_one_direction_at_least() -> None:
    kinds = {one for one in get_args(Submessage) if one is not Acknack}
    up, down = (
        {kind: said for kind in kinds if (said := submessage_sentence(filled(kind), "knob", up=is_up))}
        for is_up in (True, False)
    )
    assert len({*up.values(), *down.values()}) == len(up) + len(down)
    assert all(sentence.startswith("knob ") for sentence in up.values())
    assert sum(not sentence.startswith("the master ") for sentence in down.values()) == 1  # `knob hears something`


def test_who_sends_a_piece() -> None:
    assert piece_sentence("knob", up=True) == "a piece of what knob sends"
    assert piece_sentence("knob", up=False) == "a piece of what the master sends to knob"
