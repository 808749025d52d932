"""Recorded dialogues again, with one side replaced by ours: it says what the genuine side said, byte for byte.

Left out is what depends on the clock (HEARTBEATs, time stamps). The captures with losses are left out, too: what is
sent again when depends on the clock as well.
"""

from __future__ import annotations

from collections import Counter

import pytest

from msbot_xrce import AgentSession, ClientSession
from msbot_xrce.messages import CreateClient, Data, Fragment, StatusReply, iter_submessages
from msbot_xrce.sessions import (
    CreateRequested,
    DeleteRequested,
    InfoRequested,
    ReadRequested,
    SessionDeleteRequested,
)

from .captures import CAPTURES, Recorded, recorded

CLOCK_KINDS = (b"\x0b", b"\x0f", b"\x02", b"\x04")
"""HEARTBEAT, TIMESTAMP_REPLY, GET_INFO: they depend on the clock; STATUS_AGENT is the business of the server."""

DEAD_CLIENT = ("udp_ex_deployment", 3)
"""A recorded client that had ended and acknowledged nothing."""


def clients_of(name: str) -> list[int]:
    """The client sockets that log in once and stay on one session id."""
    logins = Counter(record.client for record in recorded(name) if record.from_client and is_login(record.packet))
    return sorted(client for client, count in logins.items() if count == 1)


def is_login(packet: bytes) -> bool:
    return packet[0] in (0x00, 0x80) and packet[4 if packet[0] else 8] == CreateClient.ID


CASES = [
    (name, client)
    for name in CAPTURES
    if "drop" not in name and "raw" not in name and "hardliveliness" not in name
    for client in clients_of(name)
]


def is_cut_off(name: str) -> bool:
    """Whether the capture has as many records as one may have, and stops in the middle."""
    return len(recorded(name)) == 400


def dialogue(name: str, client: int) -> list[Recorded]:
    """The packets of the client's session, from the login on."""
    records = [record for record in recorded(name) if record.client == client]
    begin = next(index for index, record in enumerate(records) if record.from_client and is_login(record.packet))
    return [record for record in records[begin:] if record.packet[0] != 0x80 or is_login(record.packet)]


class GenuineAgent:
    """What the recorded agent decided: statuses by request, and samples by the packet that begins them."""

    def __init__(self, records: list[Recorded]) -> None:
        self.statuses: dict[int, int] = {}
        self.samples: dict[int, Data] = {}
        pieces: list[Fragment] = []
        began = 0
        for index, record in enumerate(records):
            for submessage in () if record.from_client else iter_submessages(record.packet, 4):
                match submessage:
                    case StatusReply():
                        self.statuses.setdefault(submessage.request_id, submessage.status)
                    case Data():
                        self.samples[index] = submessage
                    case Fragment():
                        began = began if pieces else index
                        pieces.append(submessage)
                        if submessage.last:
                            (sample,) = iter_submessages(b"".join(piece.payload for piece in pieces), 0)
                            assert isinstance(sample, Data)
                            self.samples[began] = sample
                            pieces.clear()


def answer(session: AgentSession, genuine: GenuineAgent) -> None:
    while (event := session.next_event()) is not None:
        match event:
            case CreateRequested() | DeleteRequested() | SessionDeleteRequested():
                status = genuine.statuses[event.request_id]
                session.send_status(event.request_id, event.object_id, status, event.stream_id)
            case ReadRequested() if event.request_id in genuine.statuses:
                session.send_status(event.request_id, event.object_id, genuine.statuses[event.request_id], 0x80)
            case InfoRequested():
                session.send_info(event.request_id, event.object_id)


@pytest.mark.parametrize(("name", "client"), CASES)
def test_our_agent_says_what_the_genuine_one_said(name: str, client: int) -> None:
    records = dialogue(name, client)
    genuine = GenuineAgent(records)
    login = CreateClient.decode(records[0].packet, 8, len(records[0].packet), 1)
    session = AgentSession(login.client_key, login.session_id, login.mtu, epoch_ns=lambda: 0)
    ours: list[bytes] = []
    theirs: list[bytes] = []
    for index, record in enumerate(records[1:], 1):
        if record.from_client:
            session.receive_packet(record.packet, 0.0)
            answer(session, genuine)
        else:
            theirs.append(record.packet)
        if (sample := genuine.samples.get(index)) is not None:
            assert session.send_data(sample.request_id, sample.object_id, sample.payload, record.packet[1])
        ours += session.packets_to_send(0.0)
    missing = Counter(timeless(theirs)) - Counter(timeless(ours))
    assert not missing
    if not is_cut_off(name):
        assert Counter(timeless(ours)) == Counter(timeless(theirs))


@pytest.mark.parametrize(("name", "client"), [case for case in CASES if case != DEAD_CLIENT])
def test_our_client_acknowledges_as_the_genuine_one_did(name: str, client: int) -> None:
    records = dialogue(name, client)
    session = ClientSession(1, epoch_ns=lambda: 0)
    session.connect(0.0)
    session.packets_to_send(0.0)
    theirs: list[bytes] = []
    ours: list[bytes] = []
    for record in records[1:]:
        if record.from_client:
            theirs += [record.packet] if record.packet[4] == 0x0A else []
        else:
            session.receive_packet(record.packet, 0.0)
            while session.next_event() is not None:
                pass
        ours += [packet for packet in session.packets_to_send(0.0) if packet[4] == 0x0A]
    assert ours == theirs
    assert set(session.dropped) <= {"answer that nobody asked for"}


def timeless(packets: list[bytes]) -> list[bytes]:
    return [packet for packet in packets if packet[4:5] not in CLOCK_KINDS]
