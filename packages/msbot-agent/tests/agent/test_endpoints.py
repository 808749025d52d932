"""Writers, readers, requesters and repliers: what each makes of WRITE_DATA and READ_DATA."""

from __future__ import annotations

import pytest

from msbot_agent.agent.endpoints import DataReader, DataWriter, NoEchoShape, Replier, Requester
from msbot_agent.agent.reply_routing import ReplyExchange, client_key_of, decode_identity, encode_identity
from msbot_agent.space import MemorySpace, Owner, Qos, Sample, Topic
from msbot_xrce.messages import DeliveryControl
from tests.agent.hosts import FakeHost

TOPIC = Topic("light", "Light")
REQUEST = Topic("add_Request", "Q")
REPLY = Topic("add_Reply", "A")
OWNER = Owner(1, "p")
REQUESTER = 0x0017
REPLIER = 0x0018
FOREVER = DeliveryControl()


class Service:
    """A replier and two requesters, each of a client of its own."""

    def __init__(self, *, read: bool = True) -> None:
        space = MemorySpace()
        replies = ReplyExchange(space)
        self.server, self.asker, self.other = (FakeHost(space, key, replies) for key in (9, 1, 2))
        self.replier = Replier(self.server, REPLIER, REQUEST, REPLY, Qos(), OWNER)
        self.requester = Requester(self.asker, REQUESTER, REQUEST, REPLY, Qos(depth=4), OWNER)
        self.stranger = Requester(self.other, REQUESTER, REQUEST, REPLY, Qos(depth=4), OWNER)
        if read:
            for number, endpoint in enumerate((self.replier, self.requester, self.stranger), 1):
                assert endpoint.incoming is not None
                endpoint.incoming.start(number, 0x80, FOREVER)

    def identities(self) -> list[bytes]:
        """Identities of the requests that the replier got since the last call."""
        return [payload[:24] for payload in self.server.payloads()]


def test_a_writer_writes_and_a_reader_reads() -> None:
    host = FakeHost()
    reader = DataReader(host, 0x0016, TOPIC, Qos(), OWNER, None)
    assert reader.incoming is not None
    reader.incoming.start(5, 1, FOREVER)
    writer = DataWriter(host, 0x0015, TOPIC, Qos(), OWNER)
    writer.write(1, b"sample")
    assert host.sent == [(5, 0x0016, b"sample", 1)]
    assert (reader.topic, writer.topic) == ("light", "light")


def test_a_reader_cannot_write() -> None:
    host = FakeHost()
    DataReader(host, 0x0016, TOPIC, Qos(), OWNER, None).write(1, b"nonsense")
    assert host.dropped == {"WRITE_DATA for an object that cannot write": 1}


def test_a_client_without_echo_does_not_get_its_own_samples() -> None:
    host = FakeHost()
    writer = DataWriter(host, 0x0015, TOPIC, Qos(), OWNER)
    other = FakeHost(host.space, key=2)
    reader = DataReader(
        host, 0x0016, TOPIC, Qos(depth=1), OWNER, NoEchoShape(lambda guid: client_key_of(guid) == host.key)
    )
    writer.write(1, b"own, before the read")
    DataWriter(other, 0x0015, TOPIC, Qos(), OWNER).write(1, b"other's")
    writer.write(1, b"own")
    assert reader.incoming is not None
    reader.incoming.start(1, 1, FOREVER)
    assert host.payloads() == [b"other's"]


def test_a_replier_gets_the_identity_in_front_and_the_requester_its_request_id() -> None:
    service = Service()
    service.requester.write(0x000D, b"2+2")
    ((request_id, object_id, payload, stream_id),) = service.server.sent
    assert (request_id, object_id, stream_id) == (1, REPLIER, 0x80)
    assert payload[24:] == b"2+2"
    identity = decode_identity(payload)
    assert identity is not None
    assert client_key_of(identity[0]) == 1
    service.replier.write(0x0042, payload[:24] + b"4")
    assert service.asker.sent == [(2, REQUESTER, bytes.fromhex("000d 0017") + b"4", 0x80)]
    assert service.other.sent == [], "a reply is for the one who asked"


def test_each_request_is_answered_once() -> None:
    service = Service()
    service.requester.write(1, b"?")
    (identity,) = service.identities()
    service.replier.write(1, identity + b"first")
    service.replier.write(2, identity + b"second")
    assert [payload[4:] for payload in service.asker.payloads()] == [b"first"]


@pytest.mark.parametrize("payload", [b"", bytes(23)])
def test_a_reply_without_identity_is_dropped_and_counted(payload: bytes) -> None:
    service = Service()
    service.replier.write(1, payload)
    assert service.server.dropped == {"reply without the identity of its request": 1}


def test_replies_to_nobody_are_dropped() -> None:
    service = Service()
    service.replier.write(1, encode_identity(bytes(16), 1) + b"?")
    service.requester.write(1, b"?")
    (identity,) = service.identities()
    service.replier.write(1, identity[:16] + (99).to_bytes(8, "little") + b"?")
    assert service.asker.payloads() == service.other.payloads() == []


def test_the_oldest_request_is_given_up_when_too_many_are_open() -> None:
    service = Service()
    for number in range(5):
        service.requester.write(number, b"?")
    for identity in service.identities():
        service.replier.write(1, identity + b"!")
    assert [payload[1] for payload in service.asker.payloads()] == [1, 2, 3, 4]
    assert service.requester.forgotten == 1


def test_replies_wait_for_a_read_and_those_of_others_do_not_push_them_out() -> None:
    service = Service(read=False)
    assert service.replier.incoming is not None
    service.replier.incoming.start(1, 0x80, FOREVER)
    service.requester.write(7, b"mine")
    (mine,) = service.identities()
    service.replier.write(1, mine + b"for me")
    for _ in range(20):
        service.stranger.write(8, b"theirs")
        (theirs,) = service.identities()
        service.replier.write(1, theirs + b"not for me")
    assert service.requester.incoming is not None
    service.requester.incoming.start(2, 0x80, FOREVER)
    assert [payload[4:] for payload in service.asker.payloads()] == [b"for me"]


def test_repeated_replies_that_nobody_reads_stay_bounded() -> None:
    service = Service(read=False)
    assert service.replier.incoming is not None
    service.replier.incoming.start(1, 0x80, FOREVER)
    service.requester.write(7, b"?")
    (identity,) = service.identities()
    for number in range(6):
        service.replier.write(1, identity + bytes([number]))
    assert service.asker.dropped == {"sample pushed out before the client read it": 2}
    assert service.requester.incoming is not None
    service.requester.incoming.start(2, 0x80, FOREVER)
    assert len(service.asker.payloads()) == 1


def test_requests_wait_for_the_replier_to_read() -> None:
    service = Service(read=False)
    service.requester.write(1, b"early")
    assert service.replier.incoming is not None
    service.replier.incoming.start(1, 0x80, FOREVER)
    assert [payload[24:] for payload in service.server.payloads()] == [b"early"]


def test_a_barred_requester_asks_in_vain_and_its_old_requests_are_over() -> None:
    service = Service()
    service.requester.write(1, b"before")
    (before,) = service.identities()
    service.asker.barred.add("add_Request")
    service.requester.recheck()
    assert not service.requester.attached
    service.requester.write(2, b"meanwhile")
    assert service.asker.refused == {"add_Request": 1}
    service.asker.barred.clear()
    service.requester.recheck()
    assert service.requester.attached
    service.requester.write(3, b"after")
    (after,) = service.identities()
    service.replier.write(1, before + b"too late")
    service.replier.write(1, after + b"in time")
    assert [payload[4:] for payload in service.asker.payloads()] == [b"in time"]


def test_the_gate_may_reply_for_nobody_and_its_reply_needs_no_right() -> None:
    service = Service()
    replies: list[bytes | None] = [b"nobody", None, b"no room"]
    service.asker.for_nobody["add_Request"] = lambda _: replies.pop(0)
    service.asker.barred.add("add_Request")
    service.requester.recheck()
    service.requester.write(0x000D, b"?")
    assert service.asker.sent == [(2, REQUESTER, bytes.fromhex("000d 0017") + b"nobody", 0x80)]
    service.asker.barred.clear()
    service.requester.recheck()
    service.requester.write(2, b"heard")
    service.asker.has_room = False
    service.requester.write(3, b"heard as well: the reply could not be given")
    assert [payload[24:] for payload in service.server.payloads()] == [
        b"heard",
        b"heard as well: the reply could not be given",
    ]


def test_who_may_ask_may_hear_the_answers_whatever_the_gate_says_of_the_reply_topic() -> None:
    host = FakeHost()
    host.barred |= {"add_Request", "add_Reply"}
    requester = Requester(host, REQUESTER, REQUEST, REPLY, Qos(), OWNER)
    assert not requester.attached
    host.barred.remove("add_Request")
    requester.recheck()
    assert requester.attached
    host.barred.add("add_Request")
    requester.recheck()
    assert not requester.attached


def test_a_replier_in_this_process_may_answer_within_the_request() -> None:
    space = MemorySpace()
    replies = space.writer(REPLY, Qos(), b"replier-guid----")

    def answer(sample: Sample) -> bool:
        replies.write(b"at once", (sample.writer, sample.sequence_nr))
        return True

    space.reader(REQUEST, Qos(), answer)
    host = FakeHost(space)
    requester = Requester(host, REQUESTER, REQUEST, REPLY, Qos(), OWNER)
    assert requester.incoming is not None
    requester.incoming.start(1, 0x80, FOREVER)
    requester.write(0x0102, b"?")
    assert host.payloads() == [bytes.fromhex("0102 0017") + b"at once"]
