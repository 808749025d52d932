"""The participant of the services in virtual time: found, matched, heard in order, whatever the network does."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot_agent.space.contract import Qos
from msbot_agent.space.rtps import participant as room
from msbot_agent.space.rtps import peers, rtps_message_reader, rtps_messages
from msbot_agent.space.rtps.descriptions import read_endpoint, read_participant
from msbot_agent.space.rtps.participant import CYCLONE
from msbot_agent.space.rtps.peers import MAX_OUTBOX
from msbot_agent.space.rtps.reliable_writer import RtpsEndpoint
from msbot_agent.space.rtps.rtps_messages import AckNack, Gap, NackFrag, NumberSet, RtpsData, RtpsHeartbeat
from tests.space.rtps.simulated_network import Inbox, Network, reader, write, writer


def payload(number: int, size: int = 12) -> bytes:
    """A sample that can be told from others."""
    return b"\x00\x01\x00\x00" + number.to_bytes(4, "little") + bytes(size - 8)


def matched(endpoint: RtpsEndpoint) -> bool:
    """Whether it has met another."""
    assert endpoint.writer is not None
    return any(proxy.has_begun or proxy.heard >= 0 for proxy in endpoint.writer.proxies.values())


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("loss", "disorder"), [(0.0, 0.0), (0.3, 0.0), (0.0, 0.3), (0.3, 0.2)])
def test_every_sample_arrives_once_and_in_order(seed: int, loss: float, disorder: float) -> None:
    network = Network(seed, loss=loss, disorder=disorder)
    here, there = network.join(1), network.join(2)
    _, inbox = reader(there)
    out = writer(here)
    network.run_until(lambda: matched(out))
    sent = [payload(number) for number in range(200)]
    for one in sent:
        write(network, here, out, one)
        network.run_for(0.002)
    network.run_until(lambda: len(inbox.samples) >= 200, 120)
    assert inbox.payloads == sent
    network.run_until(lambda: out.writer is not None and out.writer.waiting == 0, 120)


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_what_is_large_comes_in_fragments(loss: float) -> None:
    network = Network(3, loss=loss)
    here, there = network.join(1), network.join(2)
    _, inbox = reader(there)
    out = writer(here)
    network.run_until(lambda: matched(out))
    large = Random(1).randbytes(100_000)
    write(network, here, out, large, related=(b"g" * 16, 7))
    write(network, here, out, payload(2))
    network.run_until(lambda: len(inbox.samples) == 2, 120)
    assert inbox.payloads == [large, payload(2)]
    assert inbox.samples[0][1].inline.related == (b"g" * 16, 7)


def test_a_sample_for_one_reader_is_for_no_other_and_is_missed_by_none() -> None:
    network = Network(5, loss=0.2)
    here, one, other = network.join(1), network.join(2), network.join(3)
    (first, to_first), (second, to_second) = reader(one), reader(other)
    out = writer(here)
    network.run_until(lambda: out.writer is not None and len(out.writer.proxies) == 2)
    for number in range(30):
        target = (first, second)[number % 3 == 0]
        write(network, here, out, payload(number), readers=frozenset([target.guid]))
    network.run_until(lambda: len(to_first.samples) == 20 and len(to_second.samples) == 10, 60)
    assert to_first.payloads == [payload(number) for number in range(30) if number % 3]
    assert to_second.payloads == [payload(number) for number in range(30) if number % 3 == 0]
    network.run_until(lambda: out.writer is not None and out.writer.waiting == 0, 60)


def test_cyclone_reads_another_form() -> None:
    network = Network()
    here, fast, cyclone = network.join(1), network.join(2), network.join(3, CYCLONE)
    (_, to_fast), (_, to_cyclone) = reader(fast), reader(cyclone)
    # What a participant tells of its vendor is what counts; here both are ours.
    out = writer(here)
    network.run_until(lambda: out.writer is not None and len(out.writer.proxies) == 2)
    assert out.writer is not None
    for guid, proxy in out.writer.proxies.items():
        proxy.plain = guid[:2] == CYCLONE
    write(network, here, out, payload(1), related=(b"g" * 16, 1), plain=payload(2))
    network.run_until(lambda: to_fast.samples and to_cyclone.samples)
    assert (to_fast.payloads, to_cyclone.payloads) == ([payload(1)], [payload(2)])
    assert to_fast.samples[0][1].inline.related == (b"g" * 16, 1)
    assert to_cyclone.samples[0][1].inline.related is None


def test_who_comes_later_gets_only_what_is_written_later() -> None:
    network = Network()
    here, early = network.join(1), network.join(2)
    _, to_early = reader(early)
    out = writer(here)
    network.run_until(lambda: matched(out))
    write(network, here, out, payload(1))
    network.run_until(lambda: to_early.samples)
    late = network.join(3)
    _, to_late = reader(late)
    network.run_until(lambda: out.writer is not None and len(out.writer.proxies) == 2)
    write(network, here, out, payload(2))
    network.run_until(lambda: to_late.samples)
    assert to_late.payloads == [payload(2)]
    network.run_for(2)
    assert to_early.payloads == [payload(1), payload(2)]


def test_a_request_waits_until_the_service_knows_where_to_answer() -> None:
    network = Network()
    here, there = network.join(1), network.join(2)
    _, inbox = reader(there)
    out = writer(here, replies="rr/xReply")
    reader(here, "rr/xReply")
    network.run_until(lambda: out.writer is not None and out.writer.proxies)
    write(network, here, out, payload(1))
    network.run_for(0.3)
    assert not inbox.samples
    writer(there, "rr/xReply")
    network.run_for(0.3)
    assert inbox.payloads == [payload(1)]


def test_a_request_does_not_wait_for_ever() -> None:
    network = Network()
    here, there = network.join(1), network.join(2)
    _, inbox = reader(there)
    out = writer(here, replies="rr/xReply")
    network.run_until(lambda: out.writer is not None and out.writer.proxies)
    write(network, here, out, payload(1))
    network.run_for(room.INTRODUCTION_S + 0.1)
    assert inbox.payloads == [payload(1)]


@pytest.mark.parametrize("says_so", [True, False])
def test_who_is_gone_is_forgotten(says_so: bool) -> None:
    network = Network()
    here, there = network.join(1), network.join(2)
    reader(there)
    out = writer(here)
    network.run_until(lambda: matched(out))
    assert (here.peers, here.known) == (1, 1)
    if says_so:
        there.leave()
        network.run_for(0.1)
    else:
        network.cut(there)
        network.run_for(peers.LEASE_S + peers.LEASE_CHECK_S + 0.1)
    network.cut(there)
    assert out.writer is not None
    assert (here.peers, here.known, len(out.writer.proxies)) == (0, 0, 0)


def test_a_reader_that_is_closed_is_no_longer_known() -> None:
    network = Network(2, loss=0.3)
    here, there = network.join(1), network.join(2)
    into, _ = reader(there)
    out = writer(here)
    network.run_until(lambda: matched(out))
    there.close_endpoint(into, network.now)
    network.run_until(lambda: here.known == 0)
    assert out.writer is not None
    assert not out.writer.proxies
    newcomer = network.join(4)
    network.run_until(lambda: newcomer.peers == 2)
    network.run_for(2)
    assert newcomer.known == 1  # the writer


def test_a_reader_that_never_answers_costs_no_more_than_the_depth() -> None:
    network = Network()
    here, there = network.join(1), network.join(2)
    reader(there)
    out = writer(here, depth=16)
    network.run_until(lambda: matched(out))
    network.cut(there)
    for number in range(100):
        write(network, here, out, payload(number))
    assert out.writer is not None
    assert out.writer.waiting == 16
    assert out.writer.lost == 84


def test_an_idle_pair_says_little() -> None:
    network = Network()
    here, there = network.join(1), network.join(2)
    _, inbox = reader(there)
    out = writer(here)
    network.run_until(lambda: matched(out))
    write(network, here, out, payload(1))
    network.run_until(lambda: inbox.samples)
    network.run_for(5)
    before = network.sent
    network.run_for(60)
    assert network.sent - before <= 2 * (60 / peers.ANNOUNCE_S + 1)


def test_qos_and_types_that_do_not_fit_do_not_match() -> None:
    network = Network()
    here, there = network.join(1), network.join(2)
    there.open_reader("rq/xRequest", "Y", Qos(), Inbox())
    there.open_reader("rq/xRequest", "X", Qos(partitions=("else",)), Inbox())
    there.open_reader("rq/xRequest", "X", Qos(transient_local=True), Inbox())
    out = writer(here)
    network.run_until(lambda: here.known == 3)
    assert out.writer is not None
    assert not out.writer.proxies


# Strangers.


def test_more_participants_than_can_be_remembered_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peers, "MAX_PARTICIPANTS", 3)
    network = Network()
    members = [network.join(number) for number in range(1, 7)]
    network.run_for(3)
    assert [one.peers for one in members] == [3] * 6
    assert all("more than 3 participants" in one.dropped for one in members)


def spoken() -> list[bytes]:
    """Datagrams as they are."""
    heard: list[bytes] = []

    network = Network(4, loss=0.1)
    here, there = network.join(1), network.join(2)
    for one in (here, there):
        receive = one.receive

        def tapped(datagram: bytes, source: tuple[str, int], now: float, receive=receive) -> None:  # type: ignore[no-untyped-def]
            heard.append(datagram)
            receive(datagram, source, now)

        one.receive = tapped  # type: ignore[method-assign]
    _, inbox = reader(there)
    out = writer(here)
    network.run_until(lambda: matched(out))
    for number in range(20):
        write(network, here, out, payload(number, 5000 if number % 5 == 0 else 12))
    network.run_until(lambda: len(inbox.samples) == 20)
    there.leave()
    network.run_for(1)
    return heard


SPOKEN = spoken()


@given(st.data())
@settings(max_examples=50, deadline=None)
def test_octets_of_strangers_never_raise(data: st.DataObject) -> None:
    network = Network()
    here, there = network.join(1), network.join(2)
    reader(here)
    writer(here)
    for datagram in data.draw(st.lists(st.sampled_from(SPOKEN), min_size=1, max_size=12)):
        changed = bytearray(datagram)
        for at, octet in data.draw(
            st.lists(st.tuples(st.integers(0, len(changed) - 1), st.integers(0, 255)), max_size=6)
        ):
            changed[at] = octet
        end = data.draw(st.integers(len(changed) // 2, len(changed)))
        network.inject(bytes(changed[:end]), here, ("10.0.0.2", 7410))
        network.inject(bytes(changed[:end]), there, ("10.0.0.1", 7410))
        for one in (here, there):
            one.tick(network.now)
            assert len(one.outbox) <= MAX_OUTBOX
            one.outbox.clear()


@given(st.binary(max_size=200))
def test_no_octets_are_too_odd_to_read(octets: bytes) -> None:
    from msbot_xrce.errors import RemoteProtocolError

    for read in (rtps_message_reader.read, read_participant, read_endpoint):
        for front in (b"", b"RTPS\x02\x03\x00\x00" + bytes(12), b"\x00\x03\x00\x00"):
            try:
                read(front + octets)
            except RemoteProtocolError:
                continue


numbers = st.integers(1, (1 << 62) - 300)
ids = st.binary(min_size=4, max_size=4)
sets = st.frozensets(st.integers(0, 255), max_size=20)


@given(numbers, sets, ids, ids, st.integers(0, (1 << 32) - 1), st.booleans())
def test_submessages_are_read_as_they_were_written(
    base: int, offsets: frozenset[int], one: bytes, other: bytes, count: int, final: bool
) -> None:
    said = NumberSet(base, tuple(base + offset for offset in sorted(offsets)))
    ack = AckNack(one, other, said, count, final)
    beat = RtpsHeartbeat(one, other, base, base + 5, count, final)
    near = NumberSet(base & 0xFFFF, tuple((base & 0xFFFF) + offset for offset in sorted(offsets)))
    nack = NackFrag(one, other, base, near, count)
    octets = (
        rtps_messages.header(b"p" * 12)
        + rtps_messages.acknack(ack)
        + rtps_messages.heartbeat(beat)
        + rtps_messages.nack_frag(nack)
        + rtps_messages.gap(one, other, base, base, said.set)
        + b"".join(rtps_messages.data(one, other, base, rtps_messages.Inline((b"g" * 16, base)), b"\x00\x01\x00\x00"))
    )
    sender, found = rtps_message_reader.read(octets)
    assert sender == b"p" * 12
    assert [what for _, _, what in found] == [
        ack,
        beat,
        nack,
        Gap(one, other, base, said),
        RtpsData(one, other, base, rtps_messages.Inline((b"g" * 16, base)), b"\x00\x01\x00\x00"),
    ]
