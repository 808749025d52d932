"""The whole agent: packets from several peers on two links, time, full links, a gate that changes its mind."""

from __future__ import annotations

from collections.abc import Iterable
from random import Random

from fuzz import grammar
from fuzz.agent_world import KEYS, PEERS, AgentWorld, attack
from fuzz.case import Case, Step
from fuzz.corpus import packets
from fuzz.mutate import mutate_octets
from fuzz.virtual import play, read_logs
from msbot_xrce.messages import (
    Create,
    DeliveryControl,
    Fragment,
    Header,
    ObjectVariant,
    ReadData,
    Submessage,
    WriteData,
    make_object_id,
)
from msbot_xrce.objects import replier_variant, requester_variant


class AgentTarget:
    """See the module's docstring."""

    name = "agent"
    about = "a whole agent: nothing raises, memory is bounded, honest clients are served before, during and after"

    def make(self, random: Random) -> Case:
        """A few sessions that do something sensible, with noise between."""
        steps: list[Step] = []
        for _ in range(random.choice((1, 2, 3))):
            steps += _session(random, random.randrange(PEERS))
        for _ in range(random.randrange(12)):
            steps.insert(random.randrange(len(steps) + 1), _noise(random))
        return tuple(steps)

    def run(self, case: Case) -> Iterable[str]:
        """Attack an agent."""
        reader = read_logs()
        reader.take()

        async def main() -> set[str]:
            return await attack(AgentWorld(Random(len(case))), case)

        return play(main()) | reader.take()


def _session(random: Random, peer: int) -> list[Step]:
    session_id = random.choice((0x81, 0x81, 0x81, 0x82, 0x01, 0x7F))
    key = random.choice(KEYS)
    mtu = random.choice((512, 512, 24, 25, 64, 1400, 0xFFFF))
    header = Header(session_id, 0x80, 0, key)
    steps = [Step("packet", grammar.login(random, key, session_id, mtu), (peer,))]
    kinds = [1, 2, 3, 4, 5, 6, *random.choices((5, 6, 7, 8), k=random.randrange(4))]
    for kind in kinds:
        number = random.choice((1, 1, 1, 1, 1, 1, 2))
        create = Create(10 + kind, make_object_id(number, kind), _described(random, kind), True, True)
        steps.append(_message(random, header, [create], peer, wrong=0.03))
    if random.random() < 0.3:
        steps += _service(random, header, peer)
    for kind in (6, 7, 8):
        read = ReadData(40 + kind, make_object_id(1, kind), random.choice(grammar.STREAMS), _control(random))
        steps.append(_message(random, header, [read], peer, wrong=0.03))
    for _ in range(random.randrange(10)):
        steps.append(_action(random, header, peer))
    return steps


def _service(random: Random, header: Header, peer: int) -> list[Step]:
    """Requests that are answered."""
    names = ("add", "Q", "A", "add_Request", "add_Reply")
    variants = {7: requester_variant(*names, 0x11), 8: replier_variant(*names, 0x11)}
    steps = []
    for kind, described in variants.items():
        object_id = make_object_id(3, kind)
        read = ReadData(60 + kind, object_id, random.choice((0x80, 0x01)), _control(random))
        steps.append(_message(random, header, [Create(50 + kind, object_id, described), read], peer, wrong=0.03))
    for _ in range(random.choice((1, 3, 6))):
        request = WriteData(70, make_object_id(3, 7), grammar.payload(random))
        steps.append(_message(random, header, [request], peer, wrong=0.03))
        steps.append(Step("reply", grammar.payload(random), (peer,)))
    return steps


def _described(random: Random, kind: int) -> ObjectVariant:
    if random.random() < 0.05:
        return grammar.variant(random, kind)
    while (described := grammar.variant(random, kind)).format != 3:
        pass
    return described


def _control(random: Random) -> DeliveryControl | None:
    return DeliveryControl() if random.random() < 0.6 else grammar.control(random)


def _action(random: Random, header: Header, peer: int) -> Step:
    match random.randrange(12):
        case 8:
            return Step("signal", b"", (peer, random.randrange(2)))
        case 9:
            return (
                Step("gate", b"", (random.choice((0, 1, 2, 3)),)) if random.random() < 0.3 else Step("room", b"", (1,))
            )
        case 0 | 1 | 2:
            written = make_object_id(1, random.choice((5, 5, 7)))
            return _message(random, header, [WriteData(90, written, grammar.payload(random))], peer, wrong=0.05)
        case 3 | 4:
            return Step("ack", b"", (peer, random.choice((0, 0, 0, 1, 3, 0xFFFF))))
        case 5:
            return Step("reply", grammar.payload(random), (peer,))
        case 6:
            piece = WriteData(91, make_object_id(1, 5), random.randbytes(200)).encode()
            return _message(random, header, [Fragment(piece, last=random.random() < 0.5)], peer, wrong=0.05)
        case 7:
            return Step("wait", b"", (random.choice((0.0001, 0.01, 0.2, 0.25, 1.0, 3.5)),))
    headers = (header, header, Header(header.session_id, random.choice(grammar.STREAMS), 0, header.client_key))
    more = [grammar.from_client(random) for _ in range(random.choice((1, 1, 2, 4)))]
    return _message(random, random.choice(headers), more, peer)


def _message(random: Random, header: Header, submessages: list[Submessage], peer: int, *, wrong: float = 0.1) -> Step:
    packet = grammar.message(random, header, submessages, wrong=wrong)
    return Step("packet", packet, (peer, int(random.random() < 0.98)))


def _noise(random: Random) -> Step:
    peer = random.randrange(PEERS)
    match random.randrange(14):
        case 0:
            return Step("wait", b"", (random.choice((0.0, 0.05, 0.2, 1.0, 3.0, 5.0)),))
        case 1:
            return Step("room", b"", (random.choice((0, 1, 2, 5, -1)),))
        case 2:
            return Step("signal", b"", (peer, random.randrange(2)))
        case 3:
            return Step("gate", b"", (random.randrange(64),))
        case 4:
            return Step("kick", b"", (peer,)) if random.random() < 0.3 else Step("burst", b"", (random.randrange(12),))
        case 5:
            return Step("packet", random.randbytes(random.choice((0, 1, 3, 4, 7, 8, 12, 50))), (peer, 0))
        case 6 | 7 | 8 | 9:
            corpus = packets(of_clients=True)
            packet = random.choice(corpus)
            if random.random() < 0.7:
                packet = mutate_octets(random, packet, corpus)
            return Step("packet", packet, (peer, random.randrange(2)))
        case 10:
            return Step("packet", random.choice(packets(of_clients=False)), (peer, 0))
    session_id = random.choice((0x81, 0x80, 0x00, 0x01, 0x7F, 0xFF))
    header = Header(session_id, random.choice(grammar.STREAMS), random.choice((0, 1, 17, 0x8000)), random.choice(KEYS))
    count = random.choice((1, 1, 2, 3, 8))
    return _message(random, header, [grammar.from_client(random) for _ in range(count)], peer, wrong=0.3)
