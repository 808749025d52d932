"""Every reply goes to the one requester that asked."""

from __future__ import annotations

from msbot_agent.agent.reply_routing import ReplyExchange
from msbot_agent.space import MemorySpace, Qos, Sample, Topic

REPLY = Topic("add_Reply", "A")
ONE, OTHER = b"1" * 16, b"2" * 16


def test_replies_go_to_whom_they_answer_and_to_nobody_else() -> None:
    space = MemorySpace()
    exchange = ReplyExchange(space)
    got: dict[bytes, list[bytes]] = {ONE: [], OTHER: []}

    def asker(guid: bytes) -> None:
        def deliver(sample: Sample) -> bool:
            got[guid].append(sample.payload)
            return False

        exchange.reader(REPLY, guid, deliver)

    for guid in got:
        asker(guid)
    replier = space.writer(REPLY, Qos(), bytes(16))
    replier.write(b"for one", (ONE, 1))
    replier.write(b"for other", (OTHER, 1))
    replier.write(b"for nobody", (bytes(16), 1))
    replier.write(b"no reply at all")
    replier.write(b"for one again", (ONE, 2))
    assert got == {ONE: [b"for one", b"for one again"], OTHER: [b"for other"]}


def test_the_last_requester_takes_the_reader_along() -> None:
    space = MemorySpace()
    exchange = ReplyExchange(space)
    got: list[bytes] = []

    def deliver(sample: Sample) -> bool:
        got.append(sample.payload)
        return True

    readers = [exchange.reader(REPLY, guid, deliver) for guid in (ONE, OTHER)]
    replier = space.writer(REPLY, Qos(), bytes(16))
    readers[0].close()
    readers[0].close()
    replier.write(b"late", (ONE, 1))
    replier.write(b"in time", (OTHER, 1))
    readers[1].close()
    replier.write(b"to an empty room", (OTHER, 2))
    assert got == [b"in time"]
    assert (readers[0].delivered, readers[1].delivered) == (0, 1)
    assert (readers[0].take(), readers[0].topic, readers[0].lost) == (None, REPLY, 0)
    exchange.reader(REPLY, ONE, deliver)
    replier.write(b"open again", (ONE, 2))
    assert got[-1] == b"open again"
