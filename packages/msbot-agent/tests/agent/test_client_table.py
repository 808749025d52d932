"""Which client a packet belongs to."""

from __future__ import annotations

from functools import partial

import pytest

from msbot_agent.agent.agent_settings import AgentSettings
from msbot_agent.agent.client_table import ClientTable, ServedLink
from msbot_agent.agent.gate import ClientInfo, OpenGate
from msbot_agent.agent.proxy import Proxy
from msbot_agent.agent.reply_routing import ReplyExchange
from msbot_agent.agent.shared_state import SharedAgentState
from msbot_agent.agent.statistics import Transit
from msbot_agent.link import Peer
from msbot_agent.space import MemorySpace
from msbot_xrce import AgentSession
from tests.agent.wiring import FakeLink


@pytest.fixture
def port() -> ServedLink:
    return ServedLink(FakeLink(), batch=None)


def client(key: int, session_id: int = 0x81, peer: Peer = "peer") -> Proxy:
    space = MemorySpace()
    surroundings = SharedAgentState(
        space=space,
        replies=ReplyExchange(space),
        transit=Transit(lambda: 0.0),
        gate=OpenGate(),
        settings=AgentSettings(),
        clock=lambda: 0.0,
        agent_id=bytes(8),
        mark=lambda _: None,
        rest=lambda _: None,
    )
    session = partial(AgentSession, key, session_id, 508, epoch_ns=lambda: 0)
    return Proxy(ClientInfo(key, "fake:", peer, str(peer)), session, surroundings, 0.0, dead_after_s=30.0)


def test_a_client_is_found_by_key_and_by_address(port: ServedLink) -> None:
    table = ClientTable()
    proxy = client(7)
    table.place(proxy, port, "here")
    assert table.by_key(7) is proxy
    assert port.clients == {"here": proxy}
    assert proxy.place == (port, "here")
    assert (len(table), list(table)) == (1, [proxy])


def test_a_client_that_moves_leaves_its_old_address(port: ServedLink) -> None:
    table = ClientTable()
    proxy = client(7)
    table.place(proxy, port, "here")
    proxy.is_blocked = True
    port.blocked[proxy] = None
    other = ServedLink(FakeLink(), batch=None)
    table.place(proxy, other, "there")
    assert not port.clients
    assert not port.blocked
    assert not proxy.is_blocked
    assert other.clients == {"there": proxy}
    assert len(table) == 1


def test_any_number_of_clients_with_keys_may_share_an_address(port: ServedLink) -> None:
    table = ClientTable()
    keyed = [client(key, 0x01) for key in (1, 2)]
    plain = client(3)
    for proxy in (*keyed, plain):
        table.place(proxy, port, "gateway")
    assert port.clients == {"gateway": plain}
    assert port.members == dict.fromkeys((*keyed, plain), "gateway")
    for proxy in (*keyed, plain):
        assert table.remove(proxy)
    assert not port.members
    assert not port.clients


def test_only_sessions_below_0x80_are_found_by_the_key_in_a_header(port: ServedLink) -> None:
    table = ClientTable()
    for key, session_id in ((1, 0x01), (2, 0x81)):
        table.place(client(key, session_id), port, key)
    assert table.keyed(1, port, 1, anywhere=False) is table.by_key(1)
    assert table.keyed(2, port, 2, anywhere=True) is None
    assert table.keyed(1, port, "elsewhere", anywhere=False) is None
    assert table.keyed(1, port, "elsewhere", anywhere=True) is table.by_key(1)


def test_a_removed_client_is_gone_everywhere(port: ServedLink) -> None:
    table = ClientTable()
    proxy = client(7)
    table.place(proxy, port, "here")
    assert table.remove(proxy)
    assert not table.remove(proxy)
    assert table.by_key(7) is None
    assert proxy.place is None
    assert not port.clients


def test_a_client_that_has_gone_is_known_by_key_and_has_no_address(port: ServedLink) -> None:
    table = ClientTable()
    plain, keyed = client(7), client(8, 0x01)
    for proxy in (plain, keyed):
        table.place(proxy, port, "here")
        proxy.gone = "unplugged"
        table.set_gone(proxy)
        assert table.by_key(proxy.info.key) is proxy
        assert proxy.place is None
        assert proxy.is_blocked
    assert table.keyed(8, port, "here", anywhere=True) is None
    assert (port.clients, port.members, port.gone) == ({}, {}, {"here": [plain, keyed]})
    table.place(keyed, port, "there")
    assert not keyed.is_blocked
    assert port.gone == {"here": [plain]}
    assert table.remove(plain)
    assert not table.remove(plain)
    assert not port.gone


def test_an_address_that_somebody_else_has_taken_brings_nobody_back(port: ServedLink) -> None:
    table = ClientTable()
    gone, other = client(7), client(8)
    table.place(gone, port, "here")
    table.set_gone(gone)
    table.place(other, port, "here")
    assert not port.gone
    assert table.by_key(7) is gone
    assert table.remove(gone)
    assert port.clients == {"here": other}
