"""Sessions that are stolen, too many, or never end what they begin: bounded, and nobody else suffers."""

from __future__ import annotations

from msbot_agent.agent import AgentSettings
from tests.conformance.agent_rig import (
    DELETE_CLIENT,
    PING_INSIDE,
    AgentRig,
    acknack,
    create_client,
    data,
    fragment,
    heartbeat,
    info,
    octets,
    packets,
    participant,
    read,
    reliable,
    status,
    write,
)


def test_a_stolen_address_ends_the_old_session_and_a_stolen_key_moves_it(agent: AgentRig) -> None:
    agent.log_in()
    agent.say(participant("81 80 00 00"))
    # Another key from the same address.
    agent.log_in("0b ad 0b ad")
    assert [item.key for item in agent.agent.clients()] == [0x0BAD0BAD]
    assert agent.say(participant("81 80 00 00")) == packets(status("81 80 00 00"), acknack(1))
    # The owner comes back from its address, and the same key from another one.
    agent.log_in()
    agent.log_in(peer="thief")
    assert agent.say(PING_INSIDE) == packets(info("81 00 00 00", known=False))
    agent.log_in()
    assert agent.say(PING_INSIDE, peer="thief") == packets(info("81 00 00 00", known=False))
    assert agent.say(participant("81 80 00 00"), peer="thief") == []
    assert agent.say(participant("81 80 00 00")) == packets(status("81 80 00 00"), acknack(1))


def test_a_key_in_the_header_opens_no_session_that_has_none_there(agent: AgentRig) -> None:
    agent.log_in()
    agent.say(participant("81 80 00 00"))
    assert agent.say(participant("01 80 01 00 aa bb cc dd", object_id="00 21"), peer="thief") == []
    assert agent.say("01 00 00 00 aa bb cc dd 03 01 04 00 00 02 ff fe", peer="thief") != []
    assert len(agent.view().objects) == 1


def test_half_a_login_harms_nobody(agent: AgentRig) -> None:
    agent.log_in()
    agent.say(participant("81 80 00 00"))
    for refused in (create_client(cookie="00 00 00 00"), create_client(version="07 00"), create_client(mtu="08 00")):
        assert len(agent.say(refused)) == 1
    assert agent.say(participant("81 80 01 00")) == packets(status("81 80 01 00", code="82"), acknack(2))


def test_10000_sessions_are_served_and_the_next_is_refused(agent: AgentRig) -> None:
    for key in range(1, 10_001):
        agent.inject(octets(create_client(f"{key:08x}")), octets(participant("81 01 00 00")), peer=key)
    agent.turn()
    assert len(agent.agent.clients()) == 10_000
    assert sum(len(item.objects) for item in agent.agent.clients()) == 10_000
    assert agent.say(create_client("00 ff ff ff")) == packets(
        "81 00 00 00 04 01 0b 00 87 00 58 52 43 45 01 00 01 0f 00"
    )
    assert agent.say(PING_INSIDE, peer=5000)[-1:] == packets(info("81 00 00 00", known=True))
    agent.wait(31.0)
    assert agent.agent.clients() == []
    agent.serve_somebody()


def test_one_peer_that_logs_in_with_ever_new_keys_has_one_session(agent: AgentRig) -> None:
    agent.inject(*(octets(create_client(f"{key:08x}")) for key in range(1, 3000)), peer="client")
    agent.turn()
    assert [item.key for item in agent.agent.clients()] == [2999]


# Streams.


def test_streams_of_every_id_are_bounded(agent: AgentRig) -> None:
    agent.log_in()
    for stream in range(1, 256):
        agent.say_at_once([octets(f"81 {stream:02x} 00 00" + write("00")), octets(heartbeat(0, 9, f"{stream:02x}"))])
    assert agent.view().dropped["too many streams"] > 200
    agent.serve_somebody()


def test_fragments_without_end_are_given_up(agent: AgentRig) -> None:
    agent.log_in()
    agent.set_up()
    agent.say(reliable(6, read(stream="01")))
    piece = octets(fragment("00" * 60_000))
    for number in range(7, 7 + 20):
        assert agent.say(octets(reliable(number, "")) + piece) == packets(acknack(number + 1))
    assert agent.view().dropped == {"fragmented message larger than allowed": 1}
    assert agent.say(reliable(27, fragment("00", last=True))) == packets(acknack(28))
    assert agent.say(reliable(28, write("01"))) == packets("81 01 00 00" + data("01"), acknack(29))


def test_early_messages_are_held_as_far_as_there_is_memory() -> None:
    agent = AgentRig(settings=AgentSettings(max_message=100_000))
    agent.log_in()
    for number in range(1, 16):
        agent.say(octets(reliable(number, "")) + octets(write("00" * 20_000)))
    assert agent.view().dropped == {"early message: no memory to hold it": 11}
    assert agent.say(reliable(0, "20 01 00 00")) == packets(acknack(5, "07 ff"))
    agent.close()


def test_incomplete_messages_of_all_clients_share_one_bound() -> None:
    agent = AgentRig(settings=AgentSettings(max_held_in_all=1_000_000))
    half = octets(reliable(0, fragment("00" * 60_000)))
    for key in range(1, 101):
        agent.log_in(f"{key:08x}", peer=key)
        agent.say(half, peer=key)
    dropped = [agent.view(key).dropped for key in range(1, 101)]
    assert dropped == [{}] * 16 + [{"fragmented message larger than allowed": 1}] * 84
    # Who leaves gives it back, and what is in order needs none.
    agent.say(f"81 00 00 00 {DELETE_CLIENT}", peer=1)
    agent.log_in("00 00 01 00", peer=1)
    agent.say(half, peer=1)
    assert agent.view(0x0100).dropped == {}
    assert agent.say(participant("81 80 01 00"), peer=100) == packets(status("81 80 00 00"), acknack(2))
    agent.close()


def test_a_reader_that_never_acknowledges_keeps_a_bounded_history(agent: AgentRig) -> None:
    agent.set_up_two()
    agent.say(reliable(6, read()))
    for number in range(6, 206):
        agent.say_at_once([octets(reliable(number, write(f"{number:04x}")))], peer="writer")
    # 16 in the window, 16 in the history: the newest.
    assert len(agent.take()) == 16
    came = []
    for number in range(22, 40, 16):
        came += agent.say(acknack(number))
    assert [packet[-4:] for packet in came] == [f"{number:04x}" for number in range(190, 206)]


def test_a_client_that_asks_and_never_acknowledges_is_bounded(agent: AgentRig) -> None:
    agent.log_in()
    for number in range(500):
        agent.say_at_once([octets(participant(f"81 80 {number & 255:02x} {number >> 8:02x}", flags="03"))])
    assert agent.view().dropped == {"status: too many wait for the client's acknowledgement": 500 - 16 - 64}
    agent.serve_somebody()
