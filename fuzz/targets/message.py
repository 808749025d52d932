"""Messages of parts: decoding any octets as any class."""

from __future__ import annotations

import math
from collections.abc import Iterable
from random import Random
from types import ModuleType
from typing import Annotated

from fuzz.case import Case, Step, Violation, plain
from fuzz.mutate import mutate_octets
from msbot.part import HelloWorld, Message
from msbot.part.join import hardware_trouble, pnp_messages
from msbot.part.join.pnp_messages import (
    ClaimMessage,
    ConfigurationMessage,
    PortBinding,
    ProfileMessage,
    Setting,
    VerdictMessage,
    decode_reply,
    decode_request,
)
from msbot.part.messages import standard
from msbot.part.messages import standard as hello
from msbot.part.messages.message import fields_of
from msbot.part.messages.wire_types import AtMost, Octets, float32, float64, int8, int16, int64, uint8, uint16, uint64
from msbot.pnp.remote_agents import agent_messages
from msbot_xrce.errors import LocalProtocolError, RemoteProtocolError


class Numbers(Message):
    """Every width, badly aligned."""

    a: uint8
    b: int64
    c: bool
    d: uint16
    e: float64
    f: int8
    g: float32
    h: uint64


class Nested(Message):
    """Lists of lists, of messages, of texts; bounded and unbounded."""

    numbers: list[Numbers]
    words: Annotated[list[str], AtMost(3)]
    table: list[list[int16]]
    name: Annotated[str, AtMost(5)]
    uid: Annotated[bytes, Octets(3)]
    raw: bytes
    hello: HelloWorld


def _numbers(small: int, negative: int, real: float) -> Numbers:
    return Numbers(a=small, b=negative, c=True, d=small, e=real, f=-small // 2, g=1.5, h=2**64 - 1)


def message_classes(*modules: ModuleType) -> list[type[Message]]:
    """The messages that these modules define."""
    found = (
        one for module in modules for one in vars(module).values() if getattr(one, "__module__", "") == module.__name__
    )
    return [one for one in found if isinstance(one, type) and issubclass(one, Message)]


CLASSES: tuple[type[Message], ...] = (
    Numbers,
    Nested,
    *message_classes(hello, standard, pnp_messages, hardware_trouble, agent_messages),
)
SAMPLES: tuple[bytes, ...] = (
    Nested(
        numbers=[_numbers(1, -2, 1e300), _numbers(0, 0, 0.0)], words=["ä", ""], table=[[1, -2], []], name="x",
        uid=b"abc", raw=bytes(9), hello=HelloWorld(index=1, message="hello"),
    ).encode(),
    _numbers(255, -1, 1.5).encode(),
    ProfileMessage(index=1, message="MSBOT_MASTER", name="MSBOT_V1", id="X", dof="8-4-2021", make="M").encode(),
    ClaimMessage(part_number="ABCD", local_name="AA", uid=bytes(8), session_nonce=5).encode(),
    VerdictMessage(lease=1, configuration_version=2, beat_period_ms=1000).encode(),
    ConfigurationMessage(
        version=3, slot="AA",
        bindings=[PortBinding(port="out", topic="t", topic_type="T", direction=0, reliable=1)],
        settings=[Setting(name="period_s", value="1.0")],
    ).encode(),
)  # fmt: skip


class MessageTarget:
    """See the module's docstring."""

    name = "message"
    about = "messages of parts: RemoteProtocolError only, and decode(encode(x)) == x"

    def make(self, random: Random) -> Case:
        """A message's octets, changed."""
        octets = mutate_octets(random, random.choice(SAMPLES), SAMPLES)
        return (Step("octets", octets, (random.randrange(len(CLASSES)),)),)

    def run(self, case: Case) -> Iterable[str]:
        """Decode."""
        seen = set()
        for step in case:
            for message_class in (CLASSES[step.whole(0) % len(CLASSES)], None):
                try:
                    seen.add(_decode(step.data, message_class))
                except RemoteProtocolError as error:
                    seen.add(f"{step.whole(0) % len(CLASSES)} {plain(str(error))}")
        return seen


def _decode(octets: bytes, message_class: type[Message] | None) -> str:
    if message_class is None:
        message: Message = decode_request(octets) if len(octets) % 2 else decode_reply(octets)
    else:
        message = message_class.decode(octets)
    try:
        written = message.encode()
    except LocalProtocolError as error:
        raise Violation(f"{message!r:.200} was read, but cannot be written: {error}") from error
    again = type(message).decode(written)
    if again != message and not _has_nan(message):
        raise Violation(f"{message!r:.200} is another one when written and read")
    if again.encode() != written:
        raise Violation(f"{written.hex()} is {again.encode().hex()} when read and written")
    return f"{type(message).__name__} {len(written).bit_length()}"


def _has_nan(value: object) -> bool:
    if isinstance(value, float):
        return math.isnan(value)
    if isinstance(value, list):
        return any(_has_nan(item) for item in value)
    return isinstance(value, Message) and any(_has_nan(getattr(value, field.name)) for field in fields_of(type(value)))
