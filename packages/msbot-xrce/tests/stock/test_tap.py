"""The tap finds what a stock client could not read, in sessions of stock clients and in no others."""

from __future__ import annotations

from msbot_xrce.sessions.agent import AgentSession
from msbot_xrce.streams.settings import AgentSessionSettings
from tests.stock.tap import StockEar, Tap

REQUESTER = 0x0017


def test_what_the_agent_packs_for_its_own_clients_is_not_for_stock_ones() -> None:
    settings = AgentSessionSettings(packs=True, peer_is_stock=False)
    session = AgentSession(1, 0x81, 512, epoch_ns=lambda: 0, settings=settings)
    session.send_data(9, REQUESTER, b"12345678", 0x80)
    session.send_data(9, REQUESTER, b"12345678", 0x80)
    session.send_status(10, 0x0011, 0, 0x80)
    (packed,) = session.packets_to_send(0.0)
    ear = StockEar()
    ear.hear(packed)
    assert len(ear.complaints) == 1
    tap = Tap()
    tap.sent(session, [packed])
    assert tap.take() == [], "it is for a client of ours"


def test_it_hears_an_acknack_that_goes_back_and_a_stream_that_starts_over() -> None:
    ear = StockEar()
    for first in (5, 5, 9, 65_535 - 20):
        ear.hear(bytes.fromhex("81 00 00 00 0a 01 05 00") + first.to_bytes(2, "little") + b"\0\0\x80")
    assert len(ear.complaints) == 1
    assert "from 65515 after one from 9" in ear.complaints[0]


def test_pieces_are_joined_and_what_is_sent_again_is_heard_once() -> None:
    ear = StockEar()
    whole = bytes.fromhex("09 01 00 00 00 21 00 16") + bytes(70_000)
    cut = 60_000
    first = bytes.fromhex("81 80 00 00 0d 01 00 00") + whole[:cut]
    last = bytes.fromhex("81 80 01 00 0d 03 00 00") + whole[cut:]
    for packet in (first, first, last, first, last):
        ear.hear(packet)
    assert len(ear.complaints) == 1
    assert "counts to 65535" in ear.complaints[0]
