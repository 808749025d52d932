"""Mean costs of messages, against single frames."""

from __future__ import annotations

from random import Random

import pytest

from msbot_agent.link.can.protocol import Frame, Framing, beacon_cost, frame_bits, message_cost
from msbot_agent.link.can.protocol.frames import split
from msbot_agent.link.can.protocol.ids import CAN_FD, COMPRESSION, Beacon, CanIds, beacon_frame


def test_one_packet_costs_its_frames() -> None:
    packet = bytes(range(40))
    cost = message_cost([packet], 7, Framing(), up=True)
    frames = [Frame(0x107, data) for data in split(packet, 0, False)]
    assert cost.frames == len(frames)
    assert cost.nominal_bits == cost.bits == sum(frame_bits(frame).nominal_bits for frame in frames)
    assert cost.seconds(500_000) == pytest.approx(cost.bits / 500_000)


def test_many_packets_give_the_mean_over_all_counters() -> None:
    packets = [bytes(4)] * 64
    cost = message_cost(packets, 7, Framing(), up=False, ids=CanIds(down=0x400))
    singles = [frame_bits(Frame(0x407, split(bytes(4), q, False)[0])).nominal_bits for q in range(64)]
    assert cost.frames == 1
    assert cost.bits == pytest.approx(sum(singles) / 64)


def test_fd_frames_with_and_without_a_bit_rate_switch() -> None:
    packet = Random(1).randbytes(100)
    fast, slow = (message_cost([packet], 1, Framing(True, switch), up=True) for switch in (True, False))
    assert fast.frames == slow.frames == 2
    assert fast.data_bits > fast.nominal_bits
    assert slow.data_bits == 0
    twice = message_cost([packet] * 2, 1, Framing(True, True), up=True)
    assert twice.frames == 2
    assert (twice.nominal_bits, twice.data_bits) == pytest.approx((fast.nominal_bits, fast.data_bits), rel=0.05)
    assert fast.seconds(500_000, 2_000_000) == pytest.approx(fast.nominal_bits / 5e5 + fast.data_bits / 2e6)


def test_compression_comes_before_cutting() -> None:
    assert message_cost([bytes(40)], 1, Framing(compress=lambda packet: packet[:7]), up=True).frames == 1


def test_beacons_say_what_the_master_offers() -> None:
    framing = Framing(True, True, bytes)
    assert framing.caps == CAN_FD | COMPRESSION
    assert Framing().caps == 0
    cost = beacon_cost(0xC0FFEE, framing)
    assert (cost.frames, cost.data_bits) == (1, 0)
    one = frame_bits(beacon_frame(Beacon(framing.caps, 0x1234, 0xC0FFEE), CanIds())).nominal_bits
    assert cost.bits == pytest.approx(one, abs=5)
